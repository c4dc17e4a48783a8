"""From one problem's fit to the answer that a person, or a file, gets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from torch import Tensor

from kfit.core import FitResult
from kfit.geometry import to_opencv
from kfit.pose.confidence import DOUBTFUL
from kfit.pose.hypotheses import fitted_rotations
from kfit.pose.observed_object import PLAIN, WHOLE, ObservedObject
from kfit.pose.result import PoseResult

if TYPE_CHECKING:
    from kfit.pose.category_model import CategoryModel


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
        intrinsics=seen.intrinsics.double().numpy(),
        intrinsics_from=seen.intrinsics_from,
        notes=[*seen.notes, *(note for note in (hypotheses.warning, hypotheses.ambiguity) if note is not None)],
        image=seen.image,
        mask=seen.mask,
        crop=seen.crop,
        observation=seen.observation,
        drawing=drawing.numpy(),
        fit=fit,
        draw=model.draw,
    )
