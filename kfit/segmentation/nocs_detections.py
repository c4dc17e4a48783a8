"""The objects of a NOCS result as detections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kfit.geometry import CATEGORIES
from kfit.segmentation.detections import Detections

# As NOCS writes them, and as object-deformnet and those that build on it name the same things.
NOCS = ("pred_bboxes", "pred_class_ids", "pred_scores", "pred_masks")
DEFORMNET = ("rois", "class_ids", "scores", "masks")
NAMES = {category.nocs_id: name for name, category in CATEGORIES.items()}


def nocs_detections(result: Mapping[str, Any], shape: tuple[int, int]) -> Detections:
    """Read the detections of a NOCS ``results_*.pkl`` for one photo.

    Args:
        result: already read: ``pred_bboxes`` (N, 4) top, left, bottom, right with the latter two exclusive,
            ``pred_class_ids`` (N,), ``pred_scores`` (N,) and ``pred_masks`` (H, W, N); or the same as ``rois``,
            ``class_ids``, ``scores`` and ``masks``, as object-deformnet's ``mrcnn_results`` have it.
        shape: (H, W) of the photo.

    Raises:
        ValueError: if one of the four is missing, or its shape does not match the others or the photo.
    """
    keys = next((keys for keys in (NOCS, DEFORMNET) if all(key in result for key in keys)), None)
    if keys is None:
        raise ValueError(f"a NOCS result must hold {', '.join(NOCS)}; this one holds {', '.join(map(str, result))}")
    boxes, numbers, scores, masks = (np.asarray(result[key]) for key in keys)
    count = len(numbers)
    wanted = ((count, 4), (count,), (count,), (*shape, count))
    if count == 0:
        # Without objects their code writes arrays of various empty shapes.
        boxes, scores, masks = np.zeros((0, 4)), np.zeros(0), np.zeros((*shape, 0), bool)
    for key, part, want in zip(keys, (boxes, numbers, scores, masks), wanted, strict=True):
        if part.shape != want:
            raise ValueError(f"{key} must have shape {want}, got {part.shape}")
    names = [NAMES.get(int(number), f"class {int(number)}") for number in numbers]
    frames = np.tile(np.array([0.0, 0.0, shape[1], shape[0]]), (count, 1))
    placed = boxes[:, [1, 0, 3, 2]].astype(np.float64)
    return Detections(shape, placed, scores.astype(np.float64), names, masks.transpose(2, 0, 1), frames)
