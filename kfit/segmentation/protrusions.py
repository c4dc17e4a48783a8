"""Masks without the parts that stick out of them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# Radius, as a fraction of the square root of the mask's area, of the disc that fits into the object's body but not into
# a handle or a spoon. The corners of a rectangle are less than 1 % of its area each.
BODY, LEAST, MOST, NUMBER = 0.18, 0.01, 0.25, 3


def without_protrusions(mask: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Return copies of a mask, each without one of the parts that stick out of its body, the largest part first.

    The body is the mask opened by a disc: B = (M ⊖ D) ⊕ D. Protrusions are the connected parts of M \\ B with 1 % to
    25 % of the mask's area. A mug's handle is one; so is a spoon that leans on the mug.

    Args:
        mask: (H, W), above 1/2 on the object.

    Example:
        >>> import numpy as np
        >>> from kfit.segmentation import without_protrusions
        >>> mask = np.zeros((80, 120), np.float32)
        >>> mask[10:70, 10:70] = 1
        >>> mask[35:45, 70:110] = 1  # a bar to the right of a square
        >>> [square] = without_protrusions(mask)
        >>> square[:, :70].sum() > 0.95 * 3600, square[:, 75:].sum() == 0
        (np.True_, np.True_)
    """
    there = (mask > 0.5).astype(np.uint8)
    area = int(there.sum())
    radius = round(BODY * area**0.5)
    if radius < 1:
        return []
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    # The border of the picture is no border of the object.
    padded = cv2.copyMakeBorder(there, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    body = cv2.morphologyEx(padded, cv2.MORPH_OPEN, disc)[radius:-radius, radius:-radius]
    _, parts, stats, _ = cv2.connectedComponentsWithStats(there & (1 - body))
    sizes = stats[:, cv2.CC_STAT_AREA]
    wanted = [number for number in range(1, len(sizes)) if LEAST * area < sizes[number] < MOST * area]
    wanted.sort(key=lambda number: -int(sizes[number]))
    # Grown parts take the fringe with them that the opening leaves around the body.
    fringe = np.ones((2 * max(1, radius // 10) + 1,) * 2, np.uint8)
    grown = (cv2.dilate((parts == number).astype(np.uint8), fringe) > 0 for number in wanted[:NUMBER])
    return [np.where(part, np.float32(0), mask) for part in grown]
