"""Photos and masks from files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from torch import Tensor

from kfit.geometry import intrinsics_from_exif
from kfit.runtime.ignored_warnings import ignore_warnings

LARGEST_SIDE = 10_000
# Pillow reads more kinds, whatever a file is called; PostScript among them, a program that it has Ghostscript run.
KINDS = ("AVIF", "BMP", "DIB", "GIF", "JPEG", "JPEG2000", "PNG", "PPM", "TGA", "TIFF", "WEBP")
_EXIF_DIRECTORY = 0x8769


@dataclass(frozen=True)
class Photo:
    """A photo as it is to be looked at, turned upright.

    Attributes:
        image: (H, W, 3) float32, RGB in [0, 1].
        alpha: (H, W) float32 in [0, 1], where the file has such a channel.
        intrinsics: (3, 3), where the EXIF tags tell the focal length.
    """

    image: NDArray[np.float32]
    alpha: NDArray[np.float32] | None = None
    intrinsics: Tensor | None = None


def read_photo(path: str | Path) -> Photo:
    """Read a photo, with 8 or 16 bits, grey, of a palette or CMYK, with or without alpha.

    Its file is of one of the ``KINDS``, as JPEG, PNG, WebP and TIFF are. The EXIF rotation is carried out. Of a file
    with several pictures the first is read.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no image, is damaged, or has more than 10,000 pixels on a side.
    """
    picture, tags = _open(path)
    height, width = picture.height, picture.width
    alpha: NDArray[np.float32] | None = None
    if picture.has_transparency_data:
        picture = picture.convert("RGBA")
        alpha = np.asarray(picture.getchannel("A"), np.float32) / np.float32(255)
    if picture.mode.startswith("I"):
        # Pillow's own conversion would cut 16 bits off at 255.
        grey = (np.asarray(picture, np.float32) / 65535).clip(0, 1)
        image = np.repeat(grey[..., None], 3, 2)
    elif picture.mode == "F":
        raise ValueError(f"{path} holds floating-point numbers of unknown range, not a photo")
    else:
        image = np.asarray(picture.convert("RGB"), np.float32) / 255
    return Photo(image, alpha, intrinsics_from_exif(tags, width, height))


def mask_from_file(path: str | Path, shape: tuple[int, int], may_be_empty: bool = False) -> NDArray[np.float32]:
    """Read a mask: whatever is not 0 (in a palette, not entry 0) is object; in a JPEG, what is above 127.

    Args:
        shape: (H, W) of the photo that it belongs to.
        may_be_empty: the object need not be in the photo.

    Returns:
        (H, W), 1 on the object and 0 elsewhere.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no image, its size is not the photo's, or it is empty and may not be.
    """
    picture, _ = _open(path)
    if (picture.height, picture.width) != tuple(shape):
        raise ValueError(
            f"mask {path} has {picture.width} x {picture.height} pixels, the photo {shape[1]} x {shape[0]}"
        )
    if picture.mode in ("LA", "RGBA", "PA"):
        picture = picture.convert("RGB")
    values = np.asarray(picture)
    # JPEG blurs zeros into small numbers.
    there = values > (127 if picture.format == "JPEG" else 0)
    mask = np.asarray(np.atleast_3d(there).any(2), np.float32)
    if not (may_be_empty or mask.any()):
        raise ValueError(f"mask {path} is empty: all of its pixels are 0")
    return mask


def depth_from_file(path: str | Path, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Read a depth map: a 16-bit picture of millimetres, as depth cameras and NOCS write it, or metres in a .npy file.

    Args:
        shape: (H, W) of the photo that it belongs to.

    Returns:
        (H, W) in metres along the camera's axis; what is not above 0 and finite is unknown.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is neither, its size is not the photo's, or no depth is known in it.
    """
    if Path(path).suffix == ".npy":
        _check_file(path)
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
    """The alpha channel as a mask (H, W), or None where it does not set an object off.

    It does if it has opaque pixels and transparent ones; an alpha channel that is full all over says nothing.
    """
    if alpha is None or not ((alpha > 0.9).any() and (alpha < 0.1).any()):
        return None
    return alpha


def _check_file(path: str | Path) -> None:
    """Refuse what is no file: a pipe would be waited for."""
    if not Path(path).exists():
        raise FileNotFoundError(f"there is no file {path}")
    if not Path(path).is_file():
        raise ValueError(f"{path or '.'} is not an image that can be read: it is no file")


def _open(path: str | Path) -> tuple[Image.Image, dict[int, object]]:
    """The upright picture and its EXIF tags."""
    _check_file(path)
    size = None
    try:
        # Pillow warns of large pictures, which are measured below, and of EXIF tags that it cannot read.
        with ignore_warnings(), Image.open(path, formats=KINDS) as picture:
            size, kind = picture.size, picture.format
            if max(size) > LARGEST_SIDE:
                raise Image.DecompressionBombError
            exif = picture.getexif()
            tags = {**exif, **exif.get_ifd(_EXIF_DIRECTORY)}
            picture.load()
            upright = ImageOps.exif_transpose(picture)
    except Image.DecompressionBombError as error:
        has = f"{size[0]} x {size[1]} pixels, more than" if size else "far more pixels than"
        raise ValueError(f"{path} has {has} {LARGEST_SIDE:,} on a side") from error
    except (UnidentifiedImageError, PermissionError) as error:
        raise ValueError(f"{path} is not an image that can be read") from error
    except MemoryError:
        raise
    except Exception as error:  # Pillow raises whatever its many parsers raise
        raise ValueError(f"{path} is damaged or cut short") from error
    upright.format = kind
    return upright, tags
