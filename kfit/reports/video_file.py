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


class VideoFile:
    """A WebM file of VP8, to be used in a ``with`` statement and handed pictures one by one.

    Of what OpenCV's packages encode, MPEG-4 (mp4v) is played by no browser, H.264 is not among it, VP9 takes several
    times as long as VP8, and VP8 is played by Chrome, Edge, Firefox and Safari.

    Args:
        path: that ends in .webm.
        rate: pictures a second.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self.path, self.rate = path, rate
        self._writer: cv2.VideoWriter | None = None

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.release()

    def write(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture (height, width, 3), RGB, sides even numbers, as large as the first.

        Raises:
            OSError: if the file cannot be written.
        """
        if self._writer is None:
            height, width = picture.shape[:2]
            with _silence():
                self._writer = cv2.VideoWriter(
                    str(self.path), cv2.VideoWriter.fourcc(*"VP80"), self.rate, (width, height)
                )
            if not self._writer.isOpened():
                raise OSError(f"{self.path.name} cannot be written: this OpenCV ({cv2.__version__}) encodes no VP8")
        self._writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))


@contextmanager
def _silence() -> Iterator[None]:
    """Drop what C code writes to standard error: OpenCV says there that WebM has no four-letter tags, unasked."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
