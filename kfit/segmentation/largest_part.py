"""Cleaning a mask of specks and glints."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Specks and glints are smaller, the hole of a mug's handle is larger.
HOLE = 0.01


def largest_part(mask: NDArray[Any]) -> NDArray[np.uint8]:
    """The largest connected part of a mask (H, W), not empty, with holes under 1 % of it filled: 0 and 1."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats((mask > 0).astype(np.uint8))
    largest = parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    _, gaps, stats, _ = cv2.connectedComponentsWithStats((~largest).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= HOLE * largest.sum()
    whole: NDArray[np.uint8] = (largest | small[gaps]).astype(np.uint8)
    return whole
