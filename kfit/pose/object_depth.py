"""Plausibility of a depth map for the object: its unit, by the category's sizes, outliers, and what is drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Observation, Rendering
from kfit.geometry import Category

# Factors of depth that was read in the wrong unit: as metres, or as millimetres in a 16-bit picture.
UNITS = {
    "millimetres read as metres": 1000.0,
    "centimetres read as metres": 100.0,
    "inches read as metres": 1 / 0.0254,
    "0.1 mm read as millimetres": 10.0,
    "1/5000 m read as millimetres": 5.0,
    "0.25 mm read as millimetres": 4.0,
    "feet read as metres": 1 / 0.3048,
    "1/256 m read as millimetres": 0.256,
    "centimetres read as millimetres": 0.1,
    "metres divided by 1000": 0.001,
}
# An object's outline spans 0.3 to 1.1 diagonals of its box in every view. A factor of 2 allows for its own size and for
# an assumed camera.
NARROW, WIDE = 0.3 / 2, 1.1 * 2
# Largest depth of the visible part of an object, in outlines.
DEEP = 1.6
# Of two groups of depths, the nearer is the object if it has this fraction of the larger one's pixels.
NEARER = 0.8
# Fractions of the known depths that are consistent: a note below the first, a warning below the second.
MOST, FEW = 0.98, 0.7
# Drawn and measured depth agree within this many box diagonals, and should on this fraction of the object.
NEAR, AGREEING = 0.1, 0.75


def object_depth(
    depth: NDArray[Any], mask: NDArray[np.float32], intrinsics: Tensor, category: Category
) -> tuple[Tensor, list[str], list[str]]:
    """Mark depths that cannot belong to the object as unknown.

    No two points of an object are farther apart than the largest diagonal of its category, and its visible part is no
    deeper than 1.6 × its outline. The interval of this length that holds most of the known depths on the mask is the
    object, or the nearer one of two with about as many; depths farther than this from its median become unknown.

    Args:
        depth: (H, W) in metres along the camera's axis; values that are not finite or not above 0 are unknown.
        mask: (H, W), above 1/2 on the object.
        intrinsics: (3, 3).
        category: category of the object.

    Returns:
        (H, W) with NaN where the object's depth is unknown; notes; and warnings, which limit the confidence to 50 %.

    Raises:
        ValueError: if no depth on the mask is known, or it makes the object far larger or smaller than its category.
    """
    there = mask > 0.5
    known = there & np.isfinite(depth) & (depth > 0)
    if not known.any():
        raise ValueError("depth is unknown everywhere on the object: no number there is above 0")
    outline = _outline(there, float(np.median(depth[known])), intrinsics)
    least, most = category.size_range
    if not NARROW * least <= outline <= WIDE * most:
        raise ValueError(_sentence(category, outline))
    length = min(most, DEEP * outline)
    values = np.sort(depth[known].astype(np.float64))
    held = np.searchsorted(values, values + length, side="right") - np.arange(len(values))
    first = int((held >= NEARER * held.max()).argmax())
    middle = np.median(values[first : first + held[first]])
    kept = known & (np.abs(depth - middle) <= length)
    found = torch.from_numpy(np.where(kept | ~there, depth, np.nan).astype(np.float32))
    share = kept.sum() / known.sum()
    if share >= MOST:
        return found, [], []
    message = (
        f"{100 * (1 - share):.0f} % of the depths on the object lie more than {length:.2g} m from the "
        "median and are taken for unknown"
    )
    if share >= FEW:
        return found, [message], []
    return found, [], [f"{message}: does the mask cover the background? The confidence is 50 % at most"]


def wrong_size(category: Category, diagonal: float) -> str | None:
    """Return a sentence if a box diagonal in metres, found by depth, is outside of the category's range."""
    least, most = category.size_range
    if least <= diagonal <= most:
        return None
    return f"{_sentence(category, diagonal)}; the confidence is 50 % at most"


def wrong_depth(drawn: Rendering, observation: Observation, distance: float, diagonal: float) -> str | None:
    """Return a sentence if the drawing's depth differs from the measured depth on much of the object.

    Then the drawing does not have the object's shape, and what it says about distance and size is uncertain.

    Args:
        drawn: rendering of the fit, with depth in box diagonals behind the object's centre.
        observation: the observation of one object that was fitted, with its depth in metres.
        distance: of the object's centre, in metres.
        diagonal: of the object's box, in metres.
    """
    measured = observation.field("depth")
    on_object = measured.isfinite() & (observation.field("mask") > 0.5)
    off = (distance + diagonal * drawn.field("depth") - measured).abs()[on_object]
    share = float((off < NEAR * diagonal).double().mean())
    if not share < AGREEING:
        return None
    return f"drawn and measured depth agree on {100 * share:.0f} % of the object only: distance and size may be off"


def _outline(there: NDArray[np.bool_], distance: float, intrinsics: Tensor) -> float:
    """Return the diagonal in metres of the box around a mask's pixels, at a distance."""
    rows, columns = (np.flatnonzero(there.any(axis)) for axis in (1, 0))
    across = math.hypot(int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1)
    return distance * across / float(intrinsics[0, 0] + intrinsics[1, 1]) * 2


def _sentence(category: Category, diagonal: float) -> str:
    least, most = category.size_range
    message = (
        f"depth makes the {category.name} {diagonal:.3g} m large, but the diagonal of a {category.name}'s box is "
        f"between {least:g} and {most:g} m"
    )
    fitting = [name for name, times in UNITS.items() if least <= diagonal / times <= most]
    likely = sorted(fitting, key=lambda name: abs(math.log(diagonal / UNITS[name] / category.mean_diagonal)))[:2]
    if not likely:
        return f"{message}: is it in metres, are the intrinsics right, and is the mask the object's?"
    return f"{message}: is its unit wrong ({' or '.join(likely)})?"
