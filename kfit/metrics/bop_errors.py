"""Errors of poses in the format of the BOP challenge, for each object, taking symmetries into account."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

# Number of rotations that represent a continuous symmetry.
STEPS = 360
THRESHOLDS = ((5.0, 2.0), (5.0, 5.0), (10.0, 2.0), (10.0, 5.0))
"""Degrees and centimetres under which a pose is right."""


class Estimate(Protocol):
    """An estimated pose, such as `kfit.data.bop.BOPEstimate`."""

    @property
    def scene_id(self) -> int:
        """Number of the scene."""
        ...

    @property
    def im_id(self) -> int:
        """Number of the image."""
        ...

    @property
    def obj_id(self) -> int:
        """Number of the object."""
        ...

    @property
    def score(self) -> float:
        """Confidence of the estimate."""
        ...

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3), model to camera."""
        ...

    @property
    def translation(self) -> NDArray[np.float64]:
        """(3,) in metres."""
        ...


class ObjectErrors(NamedTuple):
    """Errors of an object's poses.

    Attributes:
        rotation_deg: (T,) rotation error of each of its true poses; infinite if the pose was not found.
        translation_cm: (T,) translation error, likewise.
    """

    rotation_deg: NDArray[np.float64]
    translation_cm: NDArray[np.float64]

    def recall(self, degrees: float, centimetres: float) -> float:
        """Return the share of the true poses with both errors below the thresholds."""
        return float(((self.rotation_deg < degrees) & (self.translation_cm < centimetres)).mean())


def bop_errors(
    estimates: Sequence[Estimate],
    truths: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]],
    models: Mapping[str, Any],
    objects: Sequence[int] | None = None,
) -> dict[int, ObjectErrors]:
    """Compute errors by the object's number.

    In each image the estimates of an object, most certain first, each take the free true pose that is nearest in
    translation; remaining true poses count as not found. Of poses that a symmetry of models_info.json makes alike the
    nearest in rotation counts; a continuous one is 360 turns.

    Args:
        estimates: any number.
        truths: entries of scene_gt.json by scene and image.
        models: entries of models_info.json by the object's number.
        objects: objects that count; by default all.

    Raises:
        ValueError: If an estimate's image is not in ``truths``.
    """
    found: dict[int, list[tuple[float, float]]] = {}
    by_place: dict[tuple[int, int, int], list[Estimate]] = {}
    for one in sorted(estimates, key=lambda one: -one.score):
        if (one.scene_id, one.im_id) not in truths:
            raise ValueError(f"the data set has no scene {one.scene_id} with an image {one.im_id}")
        by_place.setdefault((one.scene_id, one.im_id, one.obj_id), []).append(one)
    symmetries = {kind: _symmetries(models.get(kind, {})) for kind in models}
    for (scene, image), things in truths.items():
        for kind in {int(thing["obj_id"]) for thing in things}:
            if objects is not None and kind not in objects:
                continue
            poses = [_pose(thing) for thing in things if int(thing["obj_id"]) == kind]
            left, errors = list(range(len(poses))), [(math.inf, math.inf)] * len(poses)
            for one in by_place.get((scene, image, kind), []):
                if not left:
                    break
                nearest = min(left, key=lambda k: float(np.linalg.norm(poses[k][1] - one.translation)))
                left.remove(nearest)
                alike = symmetries.get(str(kind), [(np.eye(3), np.zeros(3))])
                errors[nearest] = _error(one, *poses[nearest], alike)
            found.setdefault(kind, []).extend(errors)
    return {kind: ObjectErrors(*np.array(errors).T) for kind, errors in sorted(found.items())}


def _pose(thing: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    try:
        rotation = np.asarray(thing["cam_R_m2c"], float).reshape(3, 3)
        return rotation, np.asarray(thing["cam_t_m2c"], float).reshape(3) / 1000
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"a true pose of object {thing.get('obj_id')} cannot be read: {error}") from None


def _symmetries(model: Mapping[str, Any]) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the rotations and translations in metres that leave a model unchanged, the identity first."""
    found = [(np.eye(3), np.zeros(3))]
    for matrix in model.get("symmetries_discrete", []):
        stored = np.asarray(matrix, float).reshape(4, 4)
        found.append((stored[:3, :3], stored[:3, 3] / 1000))
    for symmetry in model.get("symmetries_continuous", []):
        axis = np.asarray(symmetry["axis"], float)
        axis, offset = axis / np.linalg.norm(axis), np.asarray(symmetry.get("offset", (0, 0, 0)), float) / 1000
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turns = []
        for angle in 2 * math.pi / STEPS * np.arange(STEPS):
            turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
            turns.append((turn, offset - turn @ offset))
        found = [(a @ turn, a @ moved + b) for a, b in found for turn, moved in turns]
    return found


def _error(
    one: Estimate,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    alike: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[float, float]:
    turns, moves = (np.stack(part) for part in zip(*alike, strict=True))
    relative = np.einsum("ji,kjl->kil", one.rotation, rotation @ turns)
    cosine = ((np.trace(relative, axis1=1, axis2=2) - 1) / 2).clip(-1, 1)
    best = int(cosine.argmax())
    away = np.linalg.norm(one.translation - translation - rotation @ moves[best])
    return math.degrees(math.acos(cosine[best])), 100 * float(away)
