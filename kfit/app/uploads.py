"""Uploads to the page: measured before they are decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from PIL import Image, UnidentifiedImageError

from kfit.runtime.ignored_warnings import ignore_warnings
from kfit.segmentation import Photo, read_photo
from kfit.segmentation.file_kinds import is_heif, register_heif
from kfit.segmentation.photo import LARGEST_PICTURE

LARGEST_FILE = 64 * 2**20
# Those that phones, cameras and browsers write. Each further decoder is one more that strangers' bytes reach.
KINDS = {
    "JPEG": (".jpg", ".jpeg"),
    "PNG": (".png",),
    "WEBP": (".webp",),
    "AVIF": (".avif",),
    "HEIF": (".heic", ".heif"),
}
NAMES = "JPEG, PNG, WebP, AVIF or HEIC"
ENDINGS = [ending for endings in KINDS.values() for ending in endings]

Read = TypeVar("Read")


@contextmanager
def received(path: Path) -> Iterator[None]:
    """Delete an uploaded file when the ``with`` statement that reads it ends, and keep its folder out of messages.

    Raises:
        ValueError: for the ValueError or OSError of what reads it.
    """
    try:
        yield
    except (ValueError, OSError) as error:
        raise ValueError(str(error).replace(str(path), path.name)) from error
    finally:
        path.unlink(missing_ok=True)


def read_upload(path: Path) -> Photo:
    """Read an uploaded photo.

    Raises:
        ValueError: if it has more than 64 MB or 65 megapixels, is not one of the ``KINDS``, or is damaged.
        ImportError: for HEIC without the package that decodes it.
    """
    return checked(path, read_photo)


def checked(path: Path, read: Callable[[Path], Read]) -> Read:
    """What ``read`` makes of an uploaded picture; it is called only where the picture's head keeps the limits.

    Raises:
        ValueError: if the limits are broken, and the errors of ``read``, without the server's folder.
    """
    try:
        _measure(path)
        return read(path)
    except (ValueError, OSError) as error:
        raise ValueError(str(error).replace(str(path), path.name)) from error


def check_size(path: Path) -> None:
    """Refuse a file of more than 64 MB.

    Raises:
        ValueError: naming it.
    """
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise ValueError(f"{path} has {size / 2**20:.1f} MB; the page takes pictures of at most {LARGEST_FILE >> 20}")


def _measure(path: Path) -> None:
    check_size(path)
    kinds = [kind for kind in KINDS if kind != "HEIF"]
    if is_heif(path):
        register_heif()
        kinds = ["HEIF"]
    try:
        # reads the head alone, without Pillow's own warning of large pictures
        with ignore_warnings(), Image.open(path, formats=kinds) as picture:
            width, height = picture.size
    except UnidentifiedImageError as error:
        raise ValueError(f"{path} is no {NAMES} picture, which the page takes") from error
    except Image.DecompressionBombError as error:
        raise ValueError(_too_many(path, "far too many")) from error
    if width * height > LARGEST_PICTURE:
        raise ValueError(_too_many(path, f"{width} x {height}"))


def _too_many(path: Path, pixels: str) -> str:
    return f"{path} has {pixels} pixels; the page takes pictures of at most {LARGEST_PICTURE // 1_000_000} megapixels"
