"""Objects and predictions of a category in the NOCS result of one image, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.geometry import CATEGORIES, Category, Symmetry
from kfit.metrics.box_iou import Array

_LAST_ROW = (0, 0, 0, 1)


@dataclass(frozen=True)
class Truths:
    """Objects of one category: poses (T, 4, 4), sizes (T, 3), and whether they have rotational symmetry (T,)."""

    poses: Array
    sizes: Array
    symmetric: NDArray[np.bool_]

    def __getitem__(self, rows: NDArray[Any]) -> Truths:
        return Truths(self.poses[rows], self.sizes[rows], self.symmetric[rows])


@dataclass(frozen=True)
class Predictions:
    """Predictions of one category: poses (P, 4, 4), sizes (P, 3), scores (P,); ``valid`` if there is a pose."""

    poses: Array
    sizes: Array
    scores: Array
    valid: NDArray[np.bool_]

    def __getitem__(self, rows: NDArray[Any]) -> Predictions:
        return Predictions(self.poses[rows], self.sizes[rows], self.scores[rows], self.valid[rows])


def nocs_symmetry(category: str, handle_visible: bool = True) -> Symmetry:
    """Return ``"y"`` for rotational symmetry in NOCS's evaluation: bottle, bowl, can, and a mug whose handle is hidden.

    Example:
        >>> from kfit.metrics import nocs_symmetry
        >>> nocs_symmetry("mug"), nocs_symmetry("mug", handle_visible=False)
        ('none', 'y')
    """
    return "y" if category == "mug" and not handle_visible else CATEGORIES[category].symmetry


def class_ids(result: Mapping[str, Any], who: str) -> NDArray[np.int64]:
    """Return the class numbers (N,) of ``gt`` or ``pred``.

    Raises:
        ValueError: if the result has none, or they are not a list of numbers.
    """
    key = f"{who}_class_ids"
    ids = np.asarray(_get(result, key))
    if ids.ndim != 1 or ids.dtype.kind not in "iuf":
        raise ValueError(f"{_name(result)}: {key} must be (N,) numbers, got {ids.shape} {ids.dtype}")
    return ids.astype(np.int64)


def truths_of(result: Mapping[str, Any], category: Category) -> Truths:
    """Return the objects of a category. Handles count as visible if ``gt_handle_visibility`` is missing.

    Raises:
        ValueError: if a key is missing in the result, or has another shape.
    """
    ids = class_ids(result, "gt")
    poses = _array(result, "gt_RTs", (len(ids), 4, 4))
    _check_last_rows(result, "gt_RTs", poses)
    sizes = _array(result, "gt_scales", (len(ids), 3))
    visible: Array = np.ones(len(ids))
    if result.get("gt_handle_visibility") is not None:
        visible = _array(result, "gt_handle_visibility", (len(ids),))
    rows = ids == category.nocs_id
    symmetric = [nocs_symmetry(category.name, value != 0) == "y" for value in visible[rows]]
    return Truths(poses[rows], sizes[rows], np.array(symmetric, bool))


def predictions_of(result: Mapping[str, Any], category: Category, poses: str = "pred_RTs") -> Predictions:
    """Return the predictions of a category by decreasing score; a pose that is all 0 or not finite is no pose.

    Args:
        result: result of one image.
        category: category of the predictions.
        poses: key of the poses.

    Raises:
        ValueError: if a key is missing in the result, or has another shape.
    """
    ids = class_ids(result, "pred")
    found = _array(result, poses, (len(ids), 4, 4))
    valid: NDArray[np.bool_] = np.asarray(np.isfinite(found).all((1, 2)) & found.any((1, 2)))
    _check_last_rows(result, poses, found[valid])
    scores = _array(result, "pred_scores", (len(ids),))
    rows = ids == category.nocs_id
    chosen = Predictions(found[rows], _array(result, "pred_scales", (len(ids), 3))[rows], scores[rows], valid[rows])
    # The sort is not stable, so that ties equal those of the published evaluators.
    return chosen[np.argsort(chosen.scores)[::-1]]


def scale_agnostic(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result with every object and prediction scaled such that its box's diagonal is 1.

    A colour picture cannot distinguish a small near object from a large far one. Dividing the similarity [s R | t] by
    d = s · ‖size‖ keeps the picture, and gives translation errors ‖t̂ / d̂ − t / d‖ in diagonals of the object and IoUs
    that do not depend on scale: "10° 0.2d" and "NIoU" as RGB-only methods report them (DMSR, ICRA 2024; LaPose, ECCV
    2024). A threshold of x cm then means x % of the diagonal.

    Raises:
        ValueError: if a key is missing in the result, or has another shape.

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import scale_agnostic
        >>> result = {"gt_class_ids": [6], "gt_RTs": np.diag([0.1, 0.1, 0.1, 1])[None], "gt_scales": np.ones((1, 3))}
        >>> result |= {"pred_class_ids": [], "pred_RTs": [], "pred_scales": []}
        >>> scale_agnostic(result)["gt_RTs"][0].diagonal().round(3)
        array([0.577, 0.577, 0.577, 1.   ])
    """
    changed = dict(result)
    for who in ("gt", "pred"):
        count = len(class_ids(result, who))
        similarity = _array(result, f"{who}_RTs", (count, 4, 4)).copy()
        size = _array(result, f"{who}_scales", (count, 3))
        with np.errstate(all="ignore"):
            diagonal = np.cbrt(np.linalg.det(similarity[:, :3, :3])) * np.linalg.norm(size, axis=1)
            similarity[:, :3] /= diagonal[:, None, None]
        changed[f"{who}_RTs"] = similarity
    return changed


def _get(result: Mapping[str, Any], key: str) -> Any:
    if result.get(key) is None:
        raise ValueError(f"{_name(result)} has no {key}; it has {', '.join(sorted(map(str, result))) or 'nothing'}")
    return result[key]


def _array(result: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    """Return an array of floating point, in its original precision."""
    array = np.asarray(_get(result, key))
    if array.dtype.kind not in "iufb":
        raise ValueError(f"{_name(result)}: {key} must hold numbers, got {array.dtype}")
    if array.size == 0 and shape[0] == 0:
        return np.zeros(shape)
    if array.shape != shape:
        raise ValueError(f"{_name(result)}: {key} must have shape {shape} by its class ids, got {array.shape}")
    return array if array.dtype.kind == "f" else array.astype(np.float64)


def _check_last_rows(result: Mapping[str, Any], key: str, poses: Array) -> None:
    if not (poses[:, 3] == _LAST_ROW).all():
        raise ValueError(f"{_name(result)}: {key} must be similarities whose last row is 0 0 0 1")


def _name(result: Mapping[str, Any]) -> str:
    return f"the result of {result['image_path']}" if isinstance(result.get("image_path"), str) else "a result"
