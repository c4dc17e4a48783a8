"""Photos and masks from files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from torch import Tensor

from kfit.geometry import intrinsics_from_exif, was_cropped
from kfit.runtime.ignored_warnings import ignore_warnings
from kfit.segmentation.clean_mask import binary_mask
from kfit.segmentation.file_kinds import check_is_file, is_heif, register_heif, unreadable

# Pixels of a side, and of a picture: phones take 64 megapixels, which are a gigabyte of memory while they are read.
LARGEST_SIDE, LARGEST_PICTURE = 10_000, 65_000_000
# Pillow reads more kinds, whatever a file is called; PostScript among them, a program that it has Ghostscript run.
KINDS = ("AVIF", "BMP", "DIB", "GIF", "JPEG", "JPEG2000", "PNG", "PPM", "TGA", "TIFF", "WEBP")
# Of these, the ones that blur zeros into small numbers.
LOSSY = ("AVIF", "HEIF", "JPEG", "JPEG2000", "MPO", "WEBP")
CROPPED = (
    "by its EXIF tags the photo was cropped after it was taken: it is assumed to be the middle of that photo, and not "
    "scaled; distance and direction depend on it"
)
_EXIF_DIRECTORY, _TIFF_COLOURS, _YCBCR = 0x8769, 262, 6


@dataclass(frozen=True)
class Photo:
    """A photo, rotated upright.

    Attributes:
        image: (H, W, 3) float32, RGB in [0, 1].
        alpha: (H, W) float32 in [0, 1], or None.
        intrinsics: (3, 3), if the EXIF tags have the focal length.
        camera_notes: sentences about their source.
    """

    image: NDArray[np.float32]
    alpha: NDArray[np.float32] | None = None
    intrinsics: Tensor | None = None
    camera_notes: tuple[str, ...] = ()


def read_photo(path: str | Path) -> Photo:
    """Read a photo, with 8 or 16 bits, grey, of a palette or CMYK, with or without alpha.

    Its file is of one of the ``KINDS``, as JPEG, PNG, WebP, AVIF and TIFF are, or HEIC, which needs the extra
    ``kfit[heif]``. The EXIF rotation is applied. The first picture of a file is read.

    Raises:
        FileNotFoundError: if there is no such file.
        ImportError: if a HEIC picture needs a missing package.
        ValueError: if it is not an image, is damaged, or has more than 10,000 pixels on a side or 65 megapixels.
    """
    picture, tags = _open(path)
    height, width = picture.height, picture.width
    alpha: NDArray[np.float32] | None = None
    if picture.mode.startswith("I"):
        # Pillow's own conversions would cut 16 bits off at 255.
        values = np.asarray(picture)
        if (clear := picture.info.get("transparency")) is not None:
            alpha = (values != clear).astype(np.float32)
        grey = (values.astype(np.float32) / np.float32(65535)).clip(0, 1)
        image = np.repeat(grey[..., None], 3, 2)
    elif picture.mode == "F":
        raise ValueError(f"{path} holds floating-point numbers of unknown range, not a photo")
    else:
        if picture.has_transparency_data:
            picture = picture.convert("RGBA")
            alpha = np.asarray(picture.getchannel("A"), np.float32) / np.float32(255)
        image = np.asarray(picture.convert("RGB"), np.float32)
        image /= 255  # in place: a second one would be another gigabyte
    intrinsics = intrinsics_from_exif(tags, width, height)
    cropped = intrinsics is not None and was_cropped(tags, width, height)
    return Photo(image, alpha, intrinsics, (CROPPED,) * cropped)


def mask_from_file(path: str | Path, shape: tuple[int, int], may_be_empty: bool = False) -> NDArray[np.float32]:
    """Read a mask: the object is `binary_mask` of the largest channel; in a coloured palette, all but entry 0.

    Args:
        shape: (H, W) of the photo that it belongs to.
        may_be_empty: whether the mask may be empty.

    Returns:
        (H, W), 1 on the object and 0 elsewhere.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not an image, differs in size from the photo, or is empty although it must not be.
    """
    picture, _ = _open(path)
    if (picture.height, picture.width) != tuple(shape):
        raise ValueError(
            f"mask {path} has {picture.width} x {picture.height} pixels, the photo {shape[1]} x {shape[0]}"
        )
    if picture.mode in ("LA", "RGBA", "PA"):
        picture = picture.convert("RGB")
    if picture.mode == "P" and _is_grey(picture.getpalette() or []):
        picture = picture.convert("L")
    values = np.asarray(picture)
    if picture.mode == "P":
        values = values > 0
    mask = binary_mask(np.atleast_3d(values).max(2), labels=picture.format not in LOSSY)
    if not (may_be_empty or mask.any()):
        raise ValueError(f"mask {path} is empty: none of its pixels is above one half")
    return mask


def depth_from_file(path: str | Path, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Read a depth map: a 16-bit picture of millimetres, as depth cameras and NOCS write it, or metres in a .npy file.

    Args:
        shape: (H, W) of the photo that it belongs to.

    Returns:
        (H, W) in metres along the camera's axis; values that are not above 0 and finite are unknown.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is neither, differs in size from the photo, or has no known depth.
    """
    if Path(path).suffix == ".npy":
        check_is_file(path)
        try:
            metres: NDArray[Any] = np.lib.format.open_memmap(path, mode="r")  # `np.load` would open zips too
        except (ValueError, OSError, EOFError) as error:
            raise ValueError(f"depth {path} is damaged or no array of numbers") from error
        if metres.ndim != 2 or metres.dtype.kind != "f":
            raise ValueError(
                f"depth {path} must hold (H, W) metres of floating point, got {metres.shape} {metres.dtype}"
            )
        height, width = metres.shape
    else:
        picture, _ = _open(path)
        if not picture.mode.startswith("I"):
            raise ValueError(f"depth {path} must be a 16-bit picture of millimetres, got one of mode {picture.mode}")
        (width, height), metres = picture.size, np.asarray(picture, np.float32) / 1000
    if (height, width) != tuple(shape):
        raise ValueError(f"depth {path} has {width} x {height} pixels, the photo {shape[1]} x {shape[0]}")
    found = np.asarray(metres, np.float32)
    if not (np.isfinite(found) & (found > 0)).any():
        raise ValueError(f"depth {path} is unknown everywhere: no number in it is above 0")
    return found


def mask_from_alpha(alpha: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """Return the alpha channel as a mask (H, W), or None if it does not select an object.

    It selects an object if it has both opaque and transparent pixels; an alpha channel that is opaque everywhere
    selects nothing.
    """
    if alpha is None or not ((alpha > 0.9).any() and (alpha < 0.1).any()):
        return None
    return alpha


def _is_grey(palette: Sequence[int]) -> bool:
    """Return whether a palette (red, green, blue in turn) has greys only."""
    return palette[::3] == palette[1::3] == palette[2::3]


def _open(path: str | Path) -> tuple[Image.Image, dict[int, object]]:
    """Return the upright picture and its EXIF tags."""
    check_is_file(path)
    size, colours = None, None
    kinds: tuple[str, ...] = KINDS
    if is_heif(path):
        register_heif()
        kinds = ("HEIF",)
    try:
        # Pillow warns of large pictures, which are measured below, and of EXIF tags that it cannot read.
        with ignore_warnings(), Image.open(path, formats=kinds) as picture:
            size, kind = picture.size, picture.format
            colours = getattr(picture, "tag_v2", {}).get(_TIFF_COLOURS)
            if max(size) > LARGEST_SIDE or size[0] * size[1] > LARGEST_PICTURE:
                raise Image.DecompressionBombError
            exif = picture.getexif()
            tags = {**exif, **exif.get_ifd(_EXIF_DIRECTORY)}
            picture.load()
            upright = ImageOps.exif_transpose(picture)
    except Image.DecompressionBombError as error:
        has = f"{size[0]} x {size[1]} pixels" if size else "far too many pixels"
        raise ValueError(
            f"{path} has {has}; at most {LARGEST_SIDE:,} on a side and {LARGEST_PICTURE // 1_000_000} million are read"
        ) from error
    except (UnidentifiedImageError, PermissionError) as error:
        raise ValueError(unreadable(path)) from error
    except MemoryError:
        raise
    except Exception as error:  # Pillow raises whatever its many parsers raise
        if colours == _YCBCR:  # Pillow reads them from JPEG-compressed TIFFs alone
            raise ValueError(f"{path} is damaged, or a TIFF of YCbCr colours, which is to be saved as RGB") from error
        raise ValueError(f"{path} is damaged or cut short") from error
    upright.format = kind
    return upright, tags
