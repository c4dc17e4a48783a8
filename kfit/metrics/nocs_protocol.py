"""NOCS's evaluation: average precision of boxes and of poses over all images, categories and thresholds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments
from kfit.geometry import CATEGORIES
from kfit.metrics.average_precision import average_precision
from kfit.metrics.box_iou import Array, BoxIoU
from kfit.metrics.nocs_matches import iou_table, match_by_iou, match_by_pose, pose_errors
from kfit.metrics.nocs_objects import class_ids, predictions_of, truths_of

# Thresholds of the curves in the paper's released code (neural_object_fitting@7309348, nocs/eval.py).
DEGREES = tuple(float(degree) for degree in range(61))
SHIFTS_CM = tuple(i / 2 for i in range(31))
IOUS = tuple(i / 100 for i in range(101))
# NOCS's own "any rotation" and "any translation"; the paper's is 100 m, here infinity.
ANY_DEGREE, ANY_SHIFT = (360.0,), (100.0, np.inf)


@dataclass(frozen=True)
class NOCSScores:
    """Average precision in [0, 1] by category; the last row is the mean over all six.

    As published, a category without objects counts as 0 in the mean, or makes it NaN if there are predictions of it;
    `mean_of_present` omits such categories.

    Attributes:
        degrees: D thresholds of rotation; the last is 360, any rotation.
        shifts: S thresholds of translation in cm; the last two are NOCS's 100 and infinity, any translation.
        ious: K thresholds of IoU.
        iou_ap: (7, K).
        pose_ap: (7, D, S), among objects whose box was found.
        num_truths, num_predictions: (6,) in all images.
        num_found: (6,) objects whose box was found.

    Example:
        See `evaluate_nocs`, which returns it:

        >>> import numpy as np
        >>> from kfit.metrics import evaluate_nocs
        >>> pose, size = np.diag([0.1, 0.1, 0.1, 1.0])[None], np.array([[0.8, 0.9, 0.7]])
        >>> pose[0, :3, 3] = 0.1, 0.2, 1.0
        >>> result = {"gt_class_ids": [6], "gt_RTs": pose, "gt_scales": size}
        >>> result |= {"pred_class_ids": [6], "pred_RTs": pose, "pred_scales": size, "pred_scores": [0.9]}
        >>> scores = evaluate_nocs([result])
        >>> scores.mean_of_present(scores.pose(degrees=10, cm=5))
        1.0
    """

    degrees: tuple[float, ...]
    shifts: tuple[float, ...]
    ious: tuple[float, ...]
    iou_ap: NDArray[np.float64]
    pose_ap: NDArray[np.float64]
    num_truths: NDArray[np.int64]
    num_predictions: NDArray[np.int64]
    num_found: NDArray[np.int64]

    def iou(self, threshold: float) -> NDArray[np.float64]:
        """Return the AP of boxes (7,) at an IoU above the threshold.

        Raises:
            ValueError: if it was not measured at this threshold.
        """
        at: NDArray[np.float64] = self.iou_ap[:, _index("ious", self.ious, threshold)]
        return at

    def pose(self, degrees: float = ANY_DEGREE[0], cm: float = np.inf) -> NDArray[np.float64]:
        """Return the AP of poses (7,) within these degrees and centimetres.

        Raises:
            ValueError: if it was not measured at these thresholds.
        """
        row, column = _index("degrees", self.degrees, degrees), _index("shifts", self.shifts, cm)
        at: NDArray[np.float64] = self.pose_ap[:, row, column]
        return at

    def mean_of_present(self, values: NDArray[np.float64]) -> float:
        """Return the mean of AP (7,) over the categories that have objects."""
        return float(values[:-1][self.num_truths > 0].mean())


def evaluate_nocs(
    results: Iterable[Mapping[str, Any]],
    degrees: Sequence[float] = DEGREES,
    shifts: Sequence[float] = SHIFTS_CM,
    ious: Sequence[float] = IOUS,
    found_iou: float = 0.1,
    iou: BoxIoU = "nocs",
    poses: str = "pred_RTs",
) -> NOCSScores:
    """Score predictions as NOCS and object-deformnet do, threshold by threshold.

    Predictions of a category are matched image by image, by decreasing score: see ``match_by_iou`` and
    ``match_by_pose``. AP of poses is computed over the predictions and objects that were matched at ``found_iou`` only,
    so it ignores missed objects, and an error that rounding makes NaN counts as right (see ``pose_errors``). It equals
    compute_degree_cm_mAP with ``use_matches_for_pose=True`` (utils.py of hughw19/NOCS_CVPR2019@f882eb88) and, except
    for that NaN,
    compute_mAP (lib/utils.py of mentian/object-deformnet@cd43bb8f).

    Args:
        results: one mapping for each image under NOCS's names, in the order of the images' names, on which the rank of
            equal scores depends.
        degrees, shifts: thresholds of rotation in degrees and of translation in cm, to which those for any rotation
            and any translation are added.
        ious: thresholds of IoU.
        found_iou: IoU above which poses are evaluated.
        iou: how boxes are compared: ``"nocs"`` as published, see `kfit.metrics.nocs_iou`.
        poses: key of the poses. With another than ``"pred_RTs"``, boxes still come from ``"pred_RTs"``, as the paper's
            released code evaluates its ``"pred_RTs_ours"`` on NOCS's detections.

    Raises:
        ValueError: if there is no result, or a key is missing in one.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import evaluate_nocs
        >>> pose, size = np.diag([0.1, 0.1, 0.1, 1.0])[None], np.array([[0.8, 0.9, 0.7]])
        >>> pose[0, :3, 3] = 0.1, 0.2, 1.0
        >>> result = {"gt_class_ids": [6], "gt_RTs": pose, "gt_scales": size}  # one mug
        >>> result |= {"pred_class_ids": [6], "pred_RTs": pose, "pred_scales": size, "pred_scores": [0.9]}
        >>> evaluate_nocs([result]).iou(0.5)[-2]  # mugs
        np.float64(1.0)
    """
    check_arguments(evaluate_nocs, locals(), degrees=(0,), shifts=(0,), ious=(0, 1), found_iou=(0, 1))
    degrees, shifts = (*degrees, *ANY_DEGREE), (*shifts, *ANY_SHIFT)
    limits = (*ious, found_iou)
    tallies = {name: _Tally() for name in CATEGORIES}
    empty = True
    for result in results:
        empty = False
        present = {*class_ids(result, "gt").tolist(), *class_ids(result, "pred").tolist()}
        for category in CATEGORIES.values():
            if category.nocs_id not in present:
                continue
            truths, predictions = truths_of(result, category), predictions_of(result, category)
            matched, taken = match_by_iou(iou_table(iou, predictions, truths), limits)
            tally = tallies[category.name]
            tally.boxes.append(matched[:-1])
            tally.box_scores.append(predictions.scores)
            tally.num_truths += len(truths.poses)
            tally.num_found += int(taken[-1].sum())
            if poses != "pred_RTs":
                predictions = predictions_of(result, category, poses)
            found = predictions[matched[-1]]
            tally.poses.append(match_by_pose(pose_errors(found, truths[taken[-1]]), degrees, shifts))
            tally.pose_scores.append(found.scores)
    if empty:
        raise ValueError("results must hold at least one image, got none")
    by_category = list(tallies.values())
    return NOCSScores(
        degrees,
        shifts,
        tuple(ious),
        _with_mean([t.precision(t.boxes, t.box_scores, t.num_truths, (len(ious),)) for t in by_category]),
        _with_mean(
            [t.precision(t.poses, t.pose_scores, t.num_found, (len(degrees), len(shifts))) for t in by_category]
        ),
        np.array([t.num_truths for t in by_category]),
        np.array([sum(map(len, t.box_scores)) for t in by_category]),
        np.array([t.num_found for t in by_category]),
    )


class _Tally:
    """Matches and scores of one category."""

    def __init__(self) -> None:
        self.boxes: list[NDArray[np.bool_]] = []
        self.poses: list[NDArray[np.bool_]] = []
        self.box_scores: list[Array] = []
        self.pose_scores: list[Array] = []
        self.num_truths = 0
        self.num_found = 0

    @staticmethod
    def precision(
        matched: list[NDArray[np.bool_]], scores: list[Array], num_truths: int, shape: tuple[int, ...]
    ) -> NDArray[np.float64]:
        """Return the AP at every threshold; computed one row of thresholds at a time, to bound memory."""
        if not matched:
            return np.zeros(shape)
        # The sort is not stable and in double precision, so that ties equal those of the published evaluators.
        order = np.argsort(np.concatenate(scores).astype(np.float64))[::-1]
        ranked = np.concatenate(matched, -1)
        return np.array([average_precision(row[..., order], num_truths) for row in ranked]).reshape(shape)


def _with_mean(rows: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.stack([*rows, np.mean(rows, axis=0)])


def _index(name: str, thresholds: tuple[float, ...], wanted: float) -> int:
    for index, threshold in enumerate(thresholds):
        if threshold == wanted or abs(threshold - wanted) < 1e-9:
            return index
    raise ValueError(f"{name} must hold {wanted:g} for AP there; measured at {', '.join(f'{t:g}' for t in thresholds)}")
