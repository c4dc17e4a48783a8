"""From one problem's fit to the answer."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import FitResult, Rendering, Variables
from kfit.energies.lens_prior import DISTANCE_SIGMA, FOCAL_SIGMA
from kfit.generators.surface import Surface
from kfit.geometry import Category, with_focal
from kfit.pose.confidence import DOUBTFUL
from kfit.pose.hypotheses import PoseHypotheses
from kfit.pose.object_depth import wrong_depth, wrong_size
from kfit.pose.observed_object import ObservedObject
from kfit.pose.result import PoseResult

# By the source of the intrinsics. EXIF tags are rounded to a millimetre, and lenses differ from their nominal focal
# length by some percent; estimated ones have the deviation of `kfit.energies.LensPrior`, because a picture of an object
# determines its lens only weakly.
FOCAL_LOG_SD = {
    "given": 0.0,
    "EXIF": 0.03,
    "estimated": (FOCAL_SIGMA**-2 + DISTANCE_SIGMA**-2) ** -0.5,
}


def interpret(
    category: Category,
    fit: FitResult,
    observed: ObservedObject,
    placed: tuple[Tensor, Tensor, Tensor],
    hypotheses: PoseHypotheses,
    drawing: Rendering,
    draw: Callable[[Variables], Rendering],
    find_covariance: Callable[[], NDArray[np.float64]],
    surface: Callable[[], Surface] | None = None,
) -> PoseResult:
    """Build the answer of one problem's fit.

    Args:
        category: Category of the object.
        fit: Fit of one problem, on the CPU.
        observed: Object in the photo that the fit explains.
        placed: The winner's rotation (3, 3), translation (3,) and size (3,) in the photo's camera, in metres.
        hypotheses: Poses of the fit, and the confidence in the first of them.
        drawing: Rendering of the winner, one picture.
        draw: Function that renders the fit's values.
        find_covariance: Function that computes the covariance of the winner's pose.
        surface: Function that extracts the fitted object's surface.
    """
    rotation, translation, size = placed
    camera, notes = observed.intrinsics.double(), list(observed.notes)
    if not observed.lens_known:
        if "focal" in fit.values:
            camera = with_focal(camera, fit.values["focal"][0].double() * observed.crop.side)
        notes.append(_lens_note(camera, max(observed.image.shape[:2])))
    size_warning, depth_warning = None, None
    if "distance" in fit.values:
        diagonal = float(size.norm())
        size_warning = wrong_size(category, diagonal)
        depth_warning = wrong_depth(drawing, observed.observation, float(fit.values["distance"][0]), diagonal)
    most = DOUBTFUL if observed.doubtful or size_warning is not None else 1.0
    rows, columns = (np.flatnonzero((observed.mask > 0.5).any(axis)) for axis in (1, 0))
    left, top = int(columns[0]), int(rows[0])
    return PoseResult(
        category=category.name,
        symmetry=category.symmetry,
        front=category.front,
        rotation=rotation.numpy(),
        translation=translation.numpy(),
        size=size.numpy(),
        size_from="views" if "diagonal" in fit.values else "depth" if "distance" in fit.values else "mean size",
        bbox_xywh=(left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top),
        energy=float(fit.energy[0]),
        confidence=min(hypotheses.confidence, most),
        calibrated=hypotheses.calibrated,
        ambiguous=hypotheses.ambiguity is not None,
        alternatives=hypotheses.alternatives,
        intrinsics=camera.numpy(),
        intrinsics_from=observed.intrinsics_from,
        focal_log_sd=FOCAL_LOG_SD[observed.intrinsics_from],
        notes=[
            *notes,
            *(
                note
                for note in (size_warning, depth_warning, hypotheses.warning, hypotheses.ambiguity)
                if note is not None
            ),
        ],
        image=observed.image,
        mask=observed.mask,
        crop=observed.crop,
        observation=observed.observation,
        drawing=drawing.image[0].movedim(0, -1).numpy(),
        fit=fit,
        draw=draw,
        find_covariance=find_covariance,
        surface=surface,
    )


def _lens_note(camera: Tensor, longer: int) -> str:
    """Return a note on an estimated focal length."""
    focal, off = float(camera[0, 0]), math.exp(FOCAL_LOG_SD["estimated"])
    return (
        f"focal length estimated: {focal / longer:.2f} times the photo's longer side, to a factor of {off:.1f}; "
        "distance depends on it"
    )
