"""Where the object is: photos read from files, and masks from files, alpha channels and boxes."""

from kfit.segmentation.grabcut import mask_from_box
from kfit.segmentation.photo import Photo, mask_from_alpha, mask_from_file, read_photo

__all__ = ["Photo", "mask_from_alpha", "mask_from_box", "mask_from_file", "read_photo"]
