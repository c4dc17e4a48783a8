"""Correcting a mask by brush strokes."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

# A brush's width, in longer sides of the picture, and the points of a stroke beyond which the rest is dropped.
BRUSH, MOST_POINTS = 0.03, 4000


def with_stroke(mask: NDArray[np.float32], points: Sequence[tuple[float, float]], keep: bool) -> NDArray[np.float32]:
    """Return the mask (H, W) with what a brush went over added, or taken away.

    Args:
        mask: above one half on the object.
        points: (x, y) of the stroke as fractions of the picture's width and height.
        keep: whether it belongs to the object.

    Raises:
        ValueError: if nothing would be left.
    """
    height, width = mask.shape
    line = np.array([[x * width, y * height] for x, y in points[:MOST_POINTS]]).clip(0, max(height, width))
    changed = np.ascontiguousarray(mask > 0.5, np.uint8)
    broad = max(1, round(BRUSH * max(height, width)))
    line = np.concatenate((line[:1], line))  # so that a click is a line too
    cv2.polylines(changed, [line.round().astype(np.int32)], False, int(keep), broad)
    if not changed.any():
        raise ValueError("Nothing would be left of the object; the mask stays as it was.")
    return changed.astype(np.float32)
