"""Frames of a video, from a clip or from a folder of pictures, read one by one on access."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from kfit.segmentation.packet_sizes import size_change
from kfit.segmentation.photo import LARGEST_PICTURE, Photo, read_photo

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
DEFAULT_RATE = 30.0
"""Default frame rate, in frames a second."""
# FFmpeg reads playlists too, which name other files and addresses, and takes any text for a moving picture.
CLIPS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegvideo,m4v,flv,asf,ogg,ivf,gif,mjpeg,h264,hevc,mxf"
# Headers of clips have the number of frames, sometimes approximately; a clip that ends before this fraction is
# truncated.
WHOLE = 0.9
_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"


@dataclass(frozen=True)
class Frame:
    """One frame.

    Attributes:
        photo: its picture.
        time: in seconds from the start, if the file has it.
    """

    photo: Photo
    time: float | None = None


class Frames(ABC):
    """Frames of one size, to be iterated once.

    Attributes:
        count: number of frames, if known.
        rate: frames a second.
        note: after the last frame, a sentence if the file is truncated.
    """

    count: int | None = None
    rate: float = DEFAULT_RATE
    note: str = ""

    @staticmethod
    def of(path: str | Path) -> Frames:
        """Open a clip that OpenCV reads, or a folder of pictures.

        Raises:
            FileNotFoundError: if the path does not exist, or the folder holds no pictures.
            ValueError: if the file is not a readable clip.
        """
        path = Path(path)
        if not path.exists():
            raise FileNotFoundError(f"there is no clip or folder {path}")
        if path.is_dir():
            return FolderOfFrames(path)
        if not path.is_file():  # a pipe would be waited for
            raise ValueError(f"{path} is not a clip that can be read: it is neither a file nor a folder")
        return Clip(path)

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """The frames.

        Raises:
            ValueError: if a frame cannot be read, or differs in size from the first.
        """


class FolderOfFrames(Frames):
    """Pictures in a folder, in natural order of names: frame_9 comes before frame_10."""

    def __init__(self, folder: Path) -> None:
        self.files = pictures(folder)
        self.count = len(self.files)

    def __iter__(self) -> Iterator[Frame]:
        size = None
        for path in self.files:
            photo = read_photo(path)
            height, width = photo.image.shape[:2]
            size = size or (width, height)
            if (width, height) != size:
                raise ValueError(changed(str(path), (width, height), size))
            yield Frame(photo)


class Clip(Frames):
    """A video file; frames are rotated by the orientation in the file."""

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() in PICTURES:
            raise ValueError(f"{path} is one picture: give a clip or a folder of frames, or take kfit pose")
        self.path = path
        # FFmpeg would write of damaged frames to the terminal, through the progress bar; −8 is its "quiet".
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        before = os.environ.get(_OPTIONS)
        os.environ[_OPTIONS] = f"format_whitelist;{CLIPS}|protocol_whitelist;file"
        try:
            self._capture = cv2.VideoCapture(str(path))
            change = size_change(path) if self._capture.isOpened() else None
        finally:
            os.environ.pop(_OPTIONS) if before is None else os.environ.update({_OPTIONS: before})
        across, down = (int(self._capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if across * down > LARGEST_PICTURE:  # decoding one frame would take gigabytes
            raise ValueError(
                f"{path} has frames of {across} x {down} pixels, more than {LARGEST_PICTURE // 1_000_000} megapixels"
            )
        if change is not None:
            number, size, first = change
            raise ValueError(changed(f"{number} of {path}", size, first))
        self._read, self._next = self._capture.read()
        if not self._read:
            raise ValueError(f"{path} is not a clip that can be read, is damaged, or holds no frame")
        count, rate = self._capture.get(cv2.CAP_PROP_FRAME_COUNT), self._capture.get(cv2.CAP_PROP_FPS)
        self.count = int(count) if 0 < count < 1e9 else None
        self.rate = rate if 1 <= rate <= 1000 else DEFAULT_RATE

    def __iter__(self) -> Iterator[Frame]:
        num, size = 0, self._next.shape[:2]
        while self._read:
            height, width = self._next.shape[:2]
            if (height, width) != size:
                raise ValueError(changed(f"{num} of {self.path}", (width, height), (size[1], size[0])))
            pixels = cv2.cvtColor(self._next, cv2.COLOR_BGR2RGB).astype(np.float32) / np.float32(255)
            time = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            yield Frame(Photo(pixels), time if time > 0 or num == 0 else None)
            num += 1
            self._read, self._next = self._capture.read()
        self._capture.release()
        if self.count is not None and num < WHOLE * self.count:
            message = f"{num} of the {self.count} frames that it announces could be read"
            self.note = f"{self.path} is damaged or cut short: {message}"


def changed(frame: str, size: tuple[int, int], first: tuple[int, int]) -> str:
    """Return a sentence about a frame of another size."""
    return f"frame {frame} has {size[0]} x {size[1]} pixels, the first {first[0]} x {first[1]}: all must be as large"


def pictures(folder: Path) -> list[Path]:
    """Return the pictures in a folder, in natural order of names.

    Raises:
        FileNotFoundError: if there is no such folder, or no picture in it.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and not path.name.startswith(".")]
    if not found:
        raise FileNotFoundError(f"folder {folder} holds no pictures: no {', '.join(PICTURES)}")
    return sorted(found, key=lambda path: (_in_order(path.name), path.name))


def _in_order(name: str) -> list[str | int]:
    """Texts and numbers by turns."""
    return [int(part) if odd % 2 else part for odd, part in enumerate(re.split(r"(\d+)", name))]
