"""Writing a video file that browsers play."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

CODECS = {".webm": ("VP80", "VP8"), ".mp4": ("vp09", "VP9")}


class VideoFile:
    """Write a WebM file of VP8 or an MP4 file of VP9, picture by picture, in a ``with`` statement.

    OpenCV's packages encode no H.264, and no browser plays MPEG-4 (mp4v). Chrome, Edge, Firefox and Safari play VP8,
    which MP4 cannot contain; VP9 takes several times as long to encode.

    Args:
        path: path that ends in .webm or .mp4.
        rate: pictures a second.

    Raises:
        ValueError: for another ending.
        OSError: at the end of the ``with`` statement, if the file was not written to its end.

    Example:
        >>> import numpy as np
        >>> from kfit.reports import VideoFile
        >>> with VideoFile("grey.webm", rate=25) as video:
        ...     for level in range(0, 250, 10):
        ...         video.write(np.full((48, 64, 3), level, np.uint8))
    """

    def __init__(self, path: str | Path, rate: float) -> None:
        self.path, self.rate = Path(path), rate
        if self.path.suffix.lower() not in CODECS:
            raise ValueError(f"path must end in .webm or .mp4, got {str(path)!r}")
        self._writer: cv2.VideoWriter | None = None

    def __enter__(self) -> VideoFile:
        # Of a full disk OpenCV warns at each picture, and goes on.
        self._level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._writer is not None:
            self._writer.release()
        cv2.utils.logging.setLogLevel(self._level)
        if self._writer is not None and kind is None and not _has_end(self.path):
            self._ask_why()
            raise OSError(f"{self.path.name} was not written to its end")

    def write(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture (height, width, 3), RGB, sides even numbers, as large as the first.

        Raises:
            OSError: if the file cannot be written.
        """
        if self._writer is None:
            (height, width), (letters, codec) = picture.shape[:2], CODECS[self.path.suffix.lower()]
            with _silence():
                code = cv2.VideoWriter.fourcc(*letters)
                self._writer = cv2.VideoWriter(str(self.path), code, self.rate, (width, height))
            if not self._writer.isOpened():
                self._ask_why()
                raise OSError(f"{self.path.name} cannot be written: this OpenCV ({cv2.__version__}) encodes no {codec}")
        self._writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))

    def _ask_why(self) -> None:
        """Raise the system's error of writing there, which OpenCV does not report."""
        with self.path.open("ab") as file:
            file.write(bytes(2**20))
            os.fsync(file.fileno())


def _has_end(path: Path) -> bool:
    """Return whether the file has its length, which is written last, and only if all was written."""
    with _silence():
        read = cv2.VideoCapture(str(path))
        whole = bool(read.get(cv2.CAP_PROP_FRAME_COUNT) > 0)
        read.release()
    return whole


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress standard error of C code: OpenCV warns there that WebM has no four-letter tags."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
