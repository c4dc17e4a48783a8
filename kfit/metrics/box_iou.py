"""Intersection over union of two oriented boxes: as the public NOCS evaluators compute it, of hulls, and exact."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError  # type: ignore[import-untyped]

from kfit.core.arguments import check_arguments

Array = NDArray[np.floating]
BoxIoU = Literal["nocs", "axis_aligned", "oriented"]

# Number of rotations about y that the evaluators try for an object with rotational symmetry.
NUM_TURNS = 20
_EDGES = tuple((i, i | 1 << k) for k in range(3) for i in range(8) if not i & 1 << k)


def nocs_iou(pose_a: Array, size_a: Array, pose_b: Array, size_b: Array) -> NDArray[np.float64]:
    """Compute the IoU of NOCS's compute_3d_iou_new and object-deformnet's compute_3d_IoU.

    Both intend boxes along the camera's axes, but take their maxima over the three coordinates of each corner instead
    of over the corners (hughw19/NOCS_CVPR2019 issue 47). With c_i the smallest and C_i the largest coordinate of corner
    i, the "box" is the product of the eight intervals [c_i, C_i]. Published figures use it: compare with them by this
    function, and measure the overlap of boxes by `axis_aligned_iou` or `oriented_iou`. It can be 0 for boxes that
    overlap, and depends on the camera.

    Args:
        pose_a: (…, 4, 4) similarities from object to camera.
        pose_b: (4, 4).
        size_a, size_b: (3,) extents of the boxes in the objects' units.

    Returns:
        (…) in [0, 1], or NaN if a pose is not finite.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import nocs_iou
        >>> pose, moved, cube = np.eye(4), np.eye(4), np.ones(3)
        >>> moved[0, 3] = 0.5  # by half of a side
        >>> round(float(nocs_iou(pose, cube, moved, cube)), 3)
        0.0
    """
    return _interval_iou(corners(pose_a, size_a), corners(pose_b, size_b), axis=-2)


def axis_aligned_iou(pose_a: Array, size_a: Array, pose_b: Array, size_b: Array) -> NDArray[np.float64]:
    """Compute the IoU of the boxes' hulls along the camera's axes, which the NOCS evaluators intend.

    Args:
        pose_a: (…, 4, 4) similarities from object to camera.
        pose_b: (4, 4).
        size_a, size_b: (3,) extents of the boxes in the objects' units.

    Returns:
        (…) in [0, 1], or NaN if a pose is not finite.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import axis_aligned_iou
        >>> pose, moved, cube = np.eye(4), np.eye(4), np.ones(3)
        >>> moved[0, 3] = 0.5  # by half of a side
        >>> round(float(axis_aligned_iou(pose, cube, moved, cube)), 3)
        0.333
    """
    return _interval_iou(corners(pose_a, size_a), corners(pose_b, size_b), axis=-1)


def oriented_iou(pose_a: Array, size_a: Array, pose_b: Array, size_b: Array) -> NDArray[np.float64]:
    """Compute the exact IoU of two oriented boxes.

    The vertices of the intersection are the ends of the parts of one box's edges inside of the other, so the
    intersection is their convex hull.

    Args:
        pose_a: (…, 4, 4) similarities from object to camera.
        pose_b: (4, 4).
        size_a, size_b: (3,) extents of the boxes in the objects' units.

    Returns:
        (…) in [0, 1]; 0 if the boxes do not intersect or one has no volume, NaN if a pose is not finite.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import oriented_iou
        >>> pose, moved, cube = np.eye(4), np.eye(4), np.ones(3)
        >>> moved[0, 3] = 0.5  # by half of a side
        >>> round(float(oriented_iou(pose, cube, moved, cube)), 3)
        0.333
    """
    found = [_oriented_iou(pose, size_a, pose_b, size_b) for pose in pose_a.reshape(-1, 4, 4)]
    return np.array(found).reshape(pose_a.shape[:-2])


_BY_KIND = {"nocs": nocs_iou, "axis_aligned": axis_aligned_iou, "oriented": oriented_iou}


def best_iou(kind: BoxIoU, pose_a: Array, size_a: Array, pose_b: Array, size_b: Array, symmetric: bool) -> float:
    """Compute the IoU of two boxes; if ``symmetric``, the largest over 20 rotations of box a about its y axis.

    Args:
        kind: ``"nocs"``, ``"axis_aligned"`` or ``"oriented"``.
        pose_a, pose_b: (4, 4) similarities from object to camera.
        size_a, size_b: (3,) extents of the boxes in the objects' units.
        symmetric: whether object a has rotational symmetry about y.

    Raises:
        ValueError: if the kind is unknown.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import best_iou
        >>> turn = np.array([[0.8, 0, 0.6, 0], [0, 1, 0, 0], [-0.6, 0, 0.8, 0], [0, 0, 0, 1]])
        >>> cube = np.ones(3)
        >>> [round(best_iou("oriented", turn, cube, np.eye(4), cube, symmetric), 2) for symmetric in (False, True)]
        [0.71, 0.99]
    """
    check_arguments(best_iou, locals())
    with np.errstate(all="ignore"):
        if not symmetric:
            return float(_BY_KIND[kind](pose_a, size_a, pose_b, size_b))
        # NaN never exceeds the best, as in the published loop.
        return float(np.fmax.reduce(_BY_KIND[kind](pose_a @ _TURNS, size_a, pose_b, size_b), initial=0.0))


def corners(pose: Array, size: Array) -> Array:
    """Return the eight corners (…, 3, 8) of a box of ``size`` (3,) about the origin, under transforms (…, 4, 4)."""
    # Rounding depends on the order of corners and operations, which is the evaluators'.
    signs = np.array([[1 - 2 * (i >> k & 1) for i in range(8)] for k in (1, 2, 0)], dtype=size.dtype)
    moved = pose @ np.vstack([signs * size[:, None] / 2, np.ones((1, 8), dtype=np.float32)])
    here: Array = moved[..., :3, :] / moved[..., 3:, :]
    return here


def _turn(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])


_TURNS = np.stack([_turn(2 * math.pi * i / float(NUM_TURNS)) for i in range(NUM_TURNS)])


def _interval_iou(a: Array, b: Array, axis: int) -> NDArray[np.float64]:
    """Return the IoU of two products of intervals: the ranges of (…, 3, 8) corners along ``axis``."""
    low_a, high_a, low_b, high_b = a.min(axis), a.max(axis), b.min(axis), b.max(axis)
    shared = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
    intersection = np.where(shared.min(-1) < 0, 0, np.prod(shared, -1))
    overlap: NDArray[np.float64] = intersection / (np.prod(high_a - low_a, -1) + np.prod(high_b - low_b) - intersection)
    return overlap


def _oriented_iou(pose_a: Array, size_a: Array, pose_b: Array, size_b: Array) -> float:
    if not all(np.isfinite(part).all() for part in (pose_a, size_a, pose_b, size_b)):
        return math.nan
    volume_a, volume_b = (
        abs(float(np.linalg.det(pose[:3, :3]))) * float(np.prod(size))
        for pose, size in ((pose_a, size_a), (pose_b, size_b))
    )
    if min(volume_a, volume_b) <= 0:
        return 0.0
    a, b = corners(pose_a, size_a).T, corners(pose_b, size_b).T
    ends = np.concatenate([_clipped_edges(a, pose_b, size_b), _clipped_edges(b, pose_a, size_a)])
    try:
        shared = float(ConvexHull(ends).volume)
    except (QhullError, ValueError):  # fewer than four points, or all in a plane: no common volume
        return 0.0
    return min(1.0, shared / (volume_a + volume_b - shared))


def _clipped_edges(points: Array, pose: Array, size: Array) -> NDArray[np.float64]:
    """Return the ends (M, 3) of the parts of a box's edges inside of another box, by the slab method."""
    inverse = np.linalg.inv(pose.astype(np.float64))
    local = points @ inverse[:3, :3].T + inverse[:3, 3]
    start, along = np.array([[local[i], local[j] - local[i]] for i, j in _EDGES]).transpose(1, 0, 2)
    # The margin tolerates rounding if faces of both boxes lie in one plane.
    half = size.astype(np.float64) / 2 + 1e-12 * float(np.linalg.norm(size))
    still = along == 0
    step = np.where(still, 1.0, along)
    ends = np.stack([(-half - start) / step, (half - start) / step])
    enter, leave = ends.min(0), ends.max(0)
    inside = np.abs(start) <= half
    enter = np.where(still, np.where(inside, -np.inf, np.inf), enter).max(1).clip(min=0)
    leave = np.where(still, np.where(inside, np.inf, -np.inf), leave).min(1).clip(max=1)
    kept = enter <= leave
    start, along, enter, leave = start[kept], along[kept], enter[kept, None], leave[kept, None]
    found = np.concatenate([start + enter * along, start + leave * along])
    return found @ pose[:3, :3].astype(np.float64).T + pose[:3, 3]
