"""From one problem's fit to the answer that a person, or a file, gets."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from torch import Tensor

from kfit.core import FitResult
from kfit.energies.lens_prior import DISTANCE_SPREAD, FOCAL_SPREAD
from kfit.geometry import to_opencv, with_focal
from kfit.pose.confidence import DOUBTFUL
from kfit.pose.hypotheses import fitted_rotations
from kfit.pose.observed_object import PLAIN, WHOLE, ObservedObject
from kfit.pose.result import PoseResult

if TYPE_CHECKING:
    from kfit.pose.category_model import CategoryModel

# By where the intrinsics come from. EXIF tags are rounded to a millimetre, and lenses miss their names by some percent;
# what is left of both parts of `kfit.energies.LensPrior`, as little of an object's picture tells its lens.
FOCAL_LOG_SD = {
    "given": 0.0,
    "EXIF": 0.03,
    "estimated": (FOCAL_SPREAD**-2 + DISTANCE_SPREAD**-2) ** -0.5,
}


def interpret(
    model: CategoryModel,
    fit: FitResult,
    seen: ObservedObject,
    extents: Tensor,
    drawing: Tensor,
    pose_log_probabilities: Tensor | None,
) -> PoseResult:
    """What a fit of one problem says of the object that was seen.

    Args:
        model: that was fitted.
        fit: of one problem, on the CPU.
        seen: what it was fitted to.
        extents: (3,) of the winner's code.
        drawing: (S, S, 3) of the winner.
        pose_log_probabilities: (1, A, E), what the pose head says of the picture, if there is one.
    """
    rotation, translation, diagonal = model.placed(fit.values, seen.crop, seen.intrinsics)
    camera, notes = seen.intrinsics.double(), list(seen.notes)
    if not seen.lens_known:
        if "focal" in fit.values:
            camera = with_focal(camera, fit.values["focal"][0].double() * seen.crop.side)
        notes.insert(0, _lens_note(camera, max(seen.image.shape[:2])))
    # From the crop's virtual camera to the photo's: the same turn for every start, up to their shifts.
    turn = rotation[0] @ to_opencv(fitted_rotations(fit.values))[0].mT
    hypotheses = model.hypotheses(fit, turn, pose_log_probabilities)
    rows, columns = (np.flatnonzero((seen.mask > 0.5).any(axis)) for axis in (1, 0))
    left, top = int(columns[0]), int(rows[0])
    return PoseResult(
        category=model.card.category,
        rotation=rotation[0].numpy(),
        translation=translation[0].numpy(),
        size=(extents * diagonal).numpy(),
        size_from="depth" if "distance" in fit.values else "mean size",
        bbox_xywh=(left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top),
        energy=float(fit.energy[0]),
        confidence=min(hypotheses.confidence, 1.0 if {PLAIN, WHOLE}.isdisjoint(seen.notes) else DOUBTFUL),
        ambiguous=hypotheses.ambiguity is not None,
        alternatives=hypotheses.alternatives,
        intrinsics=camera.numpy(),
        intrinsics_from=seen.intrinsics_from,
        focal_log_sd=FOCAL_LOG_SD[seen.intrinsics_from],
        notes=[*notes, *(note for note in (hypotheses.warning, hypotheses.ambiguity) if note is not None)],
        image=seen.image,
        mask=seen.mask,
        crop=seen.crop,
        observation=seen.observation,
        drawing=drawing.numpy(),
        fit=fit,
        draw=model.draw,
    )


def _lens_note(camera: Tensor, longer: int) -> str:
    """A sentence on a focal length that nobody knows."""
    focal, off = float(camera[0, 0]), math.exp(FOCAL_LOG_SD["estimated"])
    return (
        f"focal length estimated: {focal / longer:.2f} times the photo's longer side, to a factor of {off:.1f}; "
        "distance depends on it"
    )
