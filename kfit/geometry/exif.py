"""Intrinsics from the EXIF tags of a photo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from kfit.geometry.camera import intrinsics_of

# EXIF tag numbers (Exif 2.32, tables 8 and 9).
_FOCAL_LENGTH, _FOCAL_LENGTH_35MM, _PIXELS_X, _PIXELS_Y = 0x920A, 0xA405, 0xA002, 0xA003
_FOCAL_PLANE_X_RESOLUTION, _FOCAL_PLANE_UNIT = 0xA20E, 0xA210
# Smaller relative differences of aspect ratios are rounding.
_ALIKE = 0.01
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}


def intrinsics_from_exif(tags: Mapping[int, Any], width: int, height: int) -> Tensor | None:
    """Compute intrinsics from a photo's EXIF tags, or return None if they do not determine them.

    From FocalLengthIn35mmFilm F, which compares *diagonals* (CIPA DCG-001), f = F · √(w² + h²) / √(36² + 24²), or
    without it from FocalLength times FocalPlaneXResolution. Both hold for the original photo of
    w × h = PixelXDimension × PixelYDimension pixels. A photo of the same aspect ratio has been scaled since, and f with
    it; one of another aspect ratio has been cropped, and f is unchanged (see `was_cropped`).

    Args:
        tags: values by tag number, including those of the Exif sub-directory.
        width, height: of the photo now, in pixels.

    Returns:
        (3, 3), pixels with centres at integers; the principal point is the photo's middle.

    Example:
        >>> from kfit.geometry import intrinsics_from_exif
        >>> intrinsics_from_exif({0xA405: 26}, 4000, 3000)[0, 0].round()  # 26 mm on film
        tensor(3005.)
    """
    taken = _taken(tags, width, height)
    scale = 1.0 if was_cropped(tags, width, height) else max(width, height) / taken[0]
    on_film = _number(tags, _FOCAL_LENGTH_35MM)
    if on_film:
        return intrinsics_of(scale * on_film * math.hypot(*taken) / math.hypot(36, 24), width, height)
    focal, resolution = _number(tags, _FOCAL_LENGTH), _number(tags, _FOCAL_PLANE_X_RESOLUTION)
    unit = _UNIT_MM.get(int(_number(tags, _FOCAL_PLANE_UNIT) or 2))
    if not (focal and resolution and unit):
        return None
    return intrinsics_of(scale * focal * resolution / unit, width, height)


def was_cropped(tags: Mapping[int, Any], width: int, height: int) -> bool:
    """Return whether a photo is a part of the one that its EXIF tags describe: not larger, and of another aspect ratio.

    Args:
        tags: as in `intrinsics_from_exif`.
        width, height: of the photo now, in pixels; it may have been rotated upright.

    Example:
        >>> from kfit.geometry import was_cropped
        >>> tags = {0xA002: 4000, 0xA003: 3000}
        >>> was_cropped(tags, 2000, 1500), was_cropped(tags, 1000, 1000)
        (False, True)
    """
    taken, now = _taken(tags, width, height), (max(width, height), min(width, height))
    if now[0] > taken[0] or now[1] > taken[1]:
        return False
    across, down = now[0] / taken[0], now[1] / taken[1]
    return abs(across - down) > _ALIKE * max(across, down)


def _taken(tags: Mapping[int, Any], width: int, height: int) -> tuple[float, float]:
    """Return the longer and the shorter side of the original photo; sides without a tag are those of the photo now."""
    longer, shorter = max(width, height), min(width, height)
    sides = [side for side in (_number(tags, _PIXELS_X), _number(tags, _PIXELS_Y)) if side is not None]
    if len(sides) < 2:
        longest = max(sides, default=longer)
        return longest, longest * shorter / longer
    return max(sides), min(sides)


def _number(tags: Mapping[int, Any], tag: int) -> float | None:
    """Return a tag as a number above 0, or None; cameras write 0 or 0/0 for "unknown"."""
    try:
        number = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < math.inf else None
