"""Matches of predictions and objects, as in the public NOCS evaluators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfit.metrics.box_iou import Array, BoxIoU, best_iou
from kfit.metrics.nocs_objects import Predictions, Truths


def iou_table(kind: BoxIoU, predictions: Predictions, truths: Truths) -> NDArray[np.float32]:
    """Return IoUs (P, T) of predictions and objects of one category, in single precision as published."""
    table = np.zeros((len(predictions.scores), len(truths.poses)), np.float32)
    for i, (pose, size) in enumerate(zip(predictions.poses, predictions.sizes, strict=True)):
        for j in range(table.shape[1]):
            table[i, j] = best_iou(kind, pose, size, truths.poses[j], truths.sizes[j], bool(truths.symmetric[j]))
    return table


def match_by_iou(
    overlaps: NDArray[np.float32], thresholds: Sequence[float]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Match each prediction in turn to the free object of largest IoU above the threshold.

    Args:
        overlaps: (P, T), predictions by decreasing score.
        thresholds: K of them.

    Returns:
        Matched predictions (K, P) and matched objects (K, T). As published, an IoU equal to the threshold is no match
        and does not end the search; objects of equal IoU are tried in the reversed order of NumPy's default sort.
    """
    limits = np.asarray(thresholds, np.float64)
    num_predictions, num_truths = overlaps.shape
    matched = np.zeros((len(limits), num_predictions), bool)
    taken = np.zeros((len(limits), num_truths), bool)
    for i in range(num_predictions):
        searching = np.ones(len(limits), bool)
        order = np.argsort(overlaps[i])[::-1]
        below = np.flatnonzero(overlaps[i, order] < 0)
        for j in order[: below[0]] if below.size else order:
            overlap = float(overlaps[i, j])
            free = searching & ~taken[:, j]
            searching &= taken[:, j] | ~(overlap < limits)
            hit = free & searching & (overlap > limits)
            taken[hit, j] = matched[hit, i] = True
            searching &= ~hit
    return matched, taken


def pose_errors(predictions: Predictions, truths: Truths) -> NDArray[np.float64]:
    """Return rotation errors in degrees and translation errors in centimetres (P, T, 2).

    θ = arccos((tr(R̂ Rᵀ) − 1) / 2), or the angle between the vertical axes of an object that is ``symmetric``; R is the
    linear part over the cube root of its determinant. As in NOCS's compute_RT_degree_cm_symmetry, the arc cosine is not
    clipped: if rounding leaves its domain, at 0° and at 180°, the error is NaN, which passes every threshold.
    Predictions without a pose get infinite errors.
    """
    errors = np.full((len(predictions.scores), len(truths.poses), 2), np.inf)
    with np.errstate(all="ignore"):
        rotations = [_rotation(pose) for pose in truths.poses]
        for i, pose in enumerate(predictions.poses):
            if not predictions.valid[i]:
                continue
            rotation = _rotation(pose)
            for j, true in enumerate(rotations):
                if truths.symmetric[j]:
                    up, true_up = rotation[:, 1].astype(np.float64), true[:, 1].astype(np.float64)
                    cosine = up.dot(true_up) / (np.linalg.norm(up) * np.linalg.norm(true_up))
                else:
                    cosine = (np.trace(rotation @ true.T) - 1) / 2
                shift = np.linalg.norm(pose[:3, 3] - truths.poses[j, :3, 3]) * 100
                errors[i, j] = np.arccos(cosine) * (180 / np.pi), shift
    return errors


def match_by_pose(errors: NDArray[np.float64], degrees: Sequence[float], shifts: Sequence[float]) -> NDArray[np.bool_]:
    """Match each prediction in turn to the free object of smallest error within the thresholds.

    Args:
        errors: (P, T, 2), predictions by decreasing score; degrees and centimetres are added.
        degrees, shifts: D and S thresholds, inclusive.

    Returns:
        Matched predictions (D, S, P).
    """
    limits = np.asarray(degrees, np.float64)[:, None], np.asarray(shifts, np.float64)[None]
    num_predictions, num_truths = errors.shape[:2]
    matched = np.zeros((len(degrees), len(shifts), num_predictions), bool)
    taken = np.zeros((len(degrees), len(shifts), num_truths), bool)
    for i in range(num_predictions):
        for j in np.argsort(errors[i].sum(-1)):
            within = ~((errors[i, j, 0] > limits[0]) | (errors[i, j, 1] > limits[1]))
            hit = within & ~taken[..., j] & ~matched[..., i]
            taken[..., j] |= hit
            matched[..., i] |= hit
    return matched


def _rotation(pose: Array) -> Array:
    linear = pose[:3, :3]
    rotation: Array = linear / np.cbrt(np.linalg.det(linear))
    return rotation
