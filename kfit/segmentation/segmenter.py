"""The contract of segmenters, which find the pixels of an object in a photo."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]
WHOLE_PICTURE = "no mask or box given: the salient object of the whole picture was used"


@dataclass(frozen=True)
class Segment:
    """The mask of one object.

    Attributes:
        mask: (H, W), 1 on the object and 0 elsewhere.
        notes: sentences about assumptions.
        warnings: sentences about possible errors, which limit the answer's confidence to 50 %.
    """

    mask: NDArray[np.float32]
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class Segmenter(ABC):
    """Finds the pixels of an object in a photo."""

    @abstractmethod
    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        """Find one object.

        Args:
            image: (H, W, 3), RGB in [0, 1].
            category: category of the object if no box selects it; one of `kfit.geometry.CATEGORIES`.
            box: left, top, width, height in pixels around the object, of any kind.

        Raises:
            ValueError: if the box cannot be used or no such object is found, in one sentence.
        """


def clipped(box: Box, width: int, height: int) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the part of a box in a picture, the latter two exclusive.

    Raises:
        ValueError: if that part has less than 4 pixels a side.
    """
    x, y, across, down = box
    described = f"box {spell(box)} (left, top, width, height)"
    if not (across > 0 and down > 0 and all(map(math.isfinite, box))):
        raise ValueError(f"{described} has no area; the picture has {width} x {height} pixels")
    left, right = max(0, round(x)), min(width, round(x + across))
    top, bottom = max(0, round(y)), min(height, round(y + down))
    if left >= right or top >= bottom:
        raise ValueError(f"{described} lies outside the picture of {width} x {height} pixels")
    if min(right - left, bottom - top) < 4:
        raise ValueError(f"{described} leaves less than 4 pixels a side in the picture of {width} x {height} pixels")
    return left, top, right, bottom


def spell(box: Box) -> str:
    """Format a box as its user wrote it."""
    return "(" + ", ".join(f"{number:g}" for number in box) + ")"
