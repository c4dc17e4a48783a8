"""Thresholding and cleaning of masks: stray parts are removed and small holes filled."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.segmenter import Segment

# Values of a mask that is 1 on the object, in floating point, 8 and 16 bits.
FULL_SCALES = (1, 255, 65535)
# Shares of the largest part's area: a smaller part is a speck wherever it lies; a part far away is dropped up to the
# second, and may be another object beyond it.
SPECK, STRAY = 0.01, 0.25
# Shares of the longer side of the largest part's box: a gap beyond it is more than a strap or a finger would leave.
FAR = 0.1
# Share of the object's area up to which a hole is a fault of the mask; that of a mug's handle is larger.
HOLE = 0.01


def binary_mask(values: NDArray[Any], labels: bool = True) -> NDArray[np.float32]:
    """Threshold a mask at one half of its full scale.

    The full scale is the smallest of 1, 255 and 65535 that no value exceeds. Soft borders, blur and artefacts of lossy
    formats are thresholded correctly.

    Args:
        values: (H, W), numbers or booleans; NaN is background.
        labels: whether values above 1, all below one half of the full scale, are labels of objects: all values above 0
            are then object. Lossy formats hold no labels.

    Returns:
        (H, W), 1 on the object and 0 elsewhere; it may be empty.

    Example:
        >>> import numpy as np
        >>> from kfit.segmentation.clean_mask import binary_mask
        >>> binary_mask(np.array([[0, 100, 200, 255]], np.uint8))
        array([[0., 0., 1., 1.]], dtype=float32)
    """
    top = float(np.nanmax(values, initial=0))
    full = next((scale for scale in FULL_SCALES if top <= scale), 2 * top)
    there = values > full / 2
    if labels and top > 1 and not there.any():
        there = values > 0
    return there.astype(np.float32)


def clean_mask(mask: NDArray[np.float32]) -> Segment:
    """Drop parts of a mask that do not belong to the object, and fill small holes.

    Holes (4 neighbours) with less than 1 % of the object's area that do not touch the picture's border are filled.

    Connected parts (8 neighbours) with less than 1 % of the largest one's area are dropped, and those with less than 25
    % that are farther from it than 0.1 of its box's longer side. A larger part that far away is kept, with a warning:
    it is another object, or the same one behind an occluder.

    Args:
        mask: (H, W) in [0, 1], above 1/2 on the object; fractions are kept. Empty masks are unchanged.

    Returns:
        The mask, with a note where parts were dropped and a warning where a large one lies far away.
    """
    parts = _without_stray_parts(mask)
    return replace(parts, mask=_without_holes(parts.mask))


def _without_holes(mask: NDArray[np.float32]) -> NDArray[np.float32]:
    there = mask > 0.5
    _, gaps, stats, _ = cv2.connectedComponentsWithStats((~there).astype(np.uint8), connectivity=4)
    right, low = stats[:, cv2.CC_STAT_LEFT] + stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_TOP] + stats[:, 3]
    inside = (stats[:, cv2.CC_STAT_LEFT] > 0) & (stats[:, cv2.CC_STAT_TOP] > 0)
    inside &= (right < mask.shape[1]) & (low < mask.shape[0])
    small = inside & (stats[:, cv2.CC_STAT_AREA] < HOLE * there.sum())
    small[0] = False  # the object itself
    return np.where(small[gaps], np.float32(1), mask) if small.any() else mask


def _without_stray_parts(mask: NDArray[np.float32]) -> Segment:
    there = (mask > 0.5).astype(np.uint8)
    number, parts, stats, _ = cv2.connectedComponentsWithStats(there)
    if number <= 2:
        return Segment(mask)
    area = stats[:, cv2.CC_STAT_AREA].astype(float)
    area[0] = 0
    main = int(area.argmax())
    share = area / area[main]
    away = cv2.distanceTransform((parts != main).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    gap = np.full(number, np.inf)
    np.minimum.at(gap, parts.ravel(), away.ravel())
    far = gap > FAR * max(stats[main, cv2.CC_STAT_WIDTH], stats[main, cv2.CC_STAT_HEIGHT])
    dropped = (share < SPECK) | (far & (share < STRAY))
    dropped[0] = False
    warnings: tuple[str, ...] = ()
    if (far & ~dropped)[1:].any():
        warnings = ("the mask has large parts far apart: is it of two objects? The confidence is 50 % at most",)
    if not dropped.any():
        return Segment(mask, warnings=warnings)
    stray = dropped[parts]
    # Soft borders go with the part that is nearer.
    to_kept, to_stray = (
        cv2.distanceTransform((~near).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for near in ((there > 0) & ~stray, stray)
    )
    note = (
        f"parts of the mask that are tiny or far from the object were left out: {int(dropped.sum())}, with "
        f"{100 * area[dropped].sum() / area.sum():.2g} % of its pixels"
    )
    return Segment(np.where(to_stray < to_kept, np.float32(0), mask), (note,), warnings)
