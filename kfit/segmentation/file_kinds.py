"""Kinds of files beyond Pillow's: HEIC, videos, addresses of the web."""

from __future__ import annotations

import re
from pathlib import Path

from PIL import Image

# FFmpeg's names of what phones and cameras record.
VIDEOS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".3gp", ".mts", ".m2ts", ".wmv", ".flv")
# Brands of ISO base media files that hold HEVC-coded still pictures (ISO/IEC 23008-12), at bytes 8 to 12.
HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")


def check_is_file(path: str | Path) -> None:
    """Refuse anything but a file: an address, a folder, or a pipe, which would block.

    Raises:
        FileNotFoundError: if there is nothing.
        ValueError: for anything but a file, in one sentence.
    """
    if re.match(r"[a-z][a-z0-9+.-]+:/", str(path), re.IGNORECASE) and not Path(path).exists():
        raise ValueError(f"{path} is an address; kfit reads files alone: download the photo and give its name")
    if not Path(path).exists():
        raise FileNotFoundError(f"there is no file {path}")
    if not Path(path).is_file():
        raise ValueError(f"{path or '.'} is not an image that can be read: it is no file")


def is_heif(path: str | Path) -> bool:
    """Whether a file holds pictures as iPhones and many cameras write them (.heic, .heif), whatever its name."""
    try:
        with open(path, "rb") as file:
            head = file.read(12)
    except OSError:  # such as a file that may not be read
        return False
    return head[4:8] == b"ftyp" and head[8:12] in HEIF_BRANDS


def register_heif() -> None:
    """Have Pillow open HEIC and HEIF files, by the package pillow-heif.

    Raises:
        ImportError: if it is not installed; the message has the command to install it.
    """
    if "HEIF" in Image.OPEN:
        return
    try:
        from pillow_heif import register_heif_opener  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        raise ImportError("HEIC and HEIF pictures need the package pillow-heif: pip install 'kfit[heif]'") from None
    register_heif_opener(thumbnails=False)


def unreadable(path: str | Path) -> str:
    """Return a sentence about a file that is not a picture."""
    if Path(path).suffix.lower() in VIDEOS:
        return f"{path} is a video, not a photo: `kfit video` follows an object through it"
    return f"{path} is not an image that can be read"
