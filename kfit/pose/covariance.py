"""The uncertainty of the pose of one object, as a 6 × 6 covariance."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix, rotation_matrix_to_axis_angle
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import FitResult, Observation, Rendering, Variables
from kfit.geometry import Symmetry, angles_from_rotation, energy_weights, num_turns, turns_about_y
from kfit.pose.card import Card
from kfit.pose.confidence import UNMEASURED
from kfit.pose.hypotheses import fitted_rotations
from kfit.pose.interpretation import FOCAL_LOG_SD
from kfit.pose.observed_object import ObservedObject
from kfit.pose.placement import placement

# Differences: rotations about the object's x, y and z axes in radians (unlike azimuth, elevation and roll, they are
# independent in views from above too), shift right and up in half-widths, and the logarithm of scale. Each moves the
# outline of an object in a picture of 64 × 64 by about half a pixel.
STEPS = (0.03, 0.03, 0.03, 0.02, 0.02, 0.02)
# Prior standard deviations of the same: angles uniform over the circle, which bounds unobservable directions.
ANGLE_SD = math.pi / 3**0.5
PRIOR_SD = (ANGLE_SD, ANGLE_SD, ANGLE_SD, 0.5, 0.5, 0.5)
# The linear theory is too small by this factor, because neighbouring pixels err together and the code is not exact.
# With it the 95 % ellipsoid holds 66 of 70 truths whose rotations were found within 20°: `kfit.bench.covariance` on 40
# table views each of unseen mugs and bottles (seed 7; mugs 32 of 35, bottles 34 of 35), and 70 of all 80.
# On as many others (seed 8) it holds 65 of 77 (mugs 28 of 40, bottles 37 of 37): of mugs it is still too small.
INFLATION = 1500.0
# Standard deviation of the logarithm of a distance from depth or several cameras. For rendered mugs, with exact depth
# and cameras, it was 0.006 (12 table views) and 0.003 (8 pairs of views); the error of real cameras is assumed.
DISTANCE_LOG_SD = 0.02


def pose_covariance(
    fit: FitResult, observed: ObservedObject, card: Card, draw: Callable[[Variables], Rendering]
) -> NDArray[np.float64]:
    """Compute the covariance (6, 6) of the answer of one problem's fit, as in `kfit.pose.PoseResult.covariance`.

    C = c · (G (JᵀJ / (k σ²) + Λ)⁻¹ Gᵀ + Σ_s w_s δ_s δ_sᵀ + s_f² g gᵀ + s_D² d dᵀ)

    - J: differences of the drawing's pixels (colours and mask) by turns, shift and log scale at the winner, and
      σ² = |r|² / (M − 6) of its M residuals that count (Gauss–Newton, as `kfit.fitting.answer_covariance`); of several
      views, the first alone is drawn. Λ is the information of an even distribution of angles, G the pose's derivatives
      by the same six, and k = 1500 was measured on held-out views.
    - δ_s: from the answer to the pose of each surviving start s, w_s its weight `kfit.geometry.energy_weights`.
    - g: the pose's derivative by the logarithm of the focal length, s_f that logarithm's deviation.
    - d: that by the logarithm of the size, which is (0, translation), s_D its deviation.
    - c: ``covariance_factor`` of the card's calibration, which makes the 95 % ellipsoid hold 95 % of right answers.

    It draws seven pictures without a gradient, of which the generator makes five.

    Args:
        fit: Fit of one problem, on the CPU.
        observed: Object in the photo that the fit explains.
        card: Card of the model.
        draw: Function that renders the fit's values.
    """
    symmetry = card.known.symmetry
    rotation, translation, _ = placement(fit.values, observed.crop, observed.intrinsics, card)

    def offsets(values: Variables, camera: Tensor = observed.intrinsics) -> Tensor:
        rotations, moved, _ = placement(values, observed.crop, camera, card)
        return torch.cat([rotation_offset(rotations, rotation, symmetry), moved - translation], 1)

    exact = {name: value.double() for name, value in fit.values.items()}
    derivatives = _central(lambda steps: offsets(_moved(exact, steps)), 6)
    precision = _information(fit.values, observed.observation.first_views(), draw) / INFLATION
    precision = precision + torch.tensor(PRIOR_SD, dtype=torch.float64).pow(-2).diag()
    covariance = derivatives @ torch.linalg.solve(precision, derivatives.mT)
    away = offsets(fit.all_values)
    covariance = covariance + away.mT @ (energy_weights(fit.all_energy.double())[:, None] * away)
    lens = _central(lambda steps: torch.cat([offsets(*_zoomed(exact, observed.intrinsics, step)) for step in steps]), 1)
    covariance = covariance + FOCAL_LOG_SD[observed.intrinsics_from] ** 2 * lens @ lens.mT
    size = torch.cat([torch.zeros_like(translation), translation], 1)
    covariance = covariance + size_log_sd(fit.values, card) ** 2 * size.mT @ size
    covariance = covariance * _factor(fit.values, card)
    if symmetry == "y":
        axis = torch.cat([rotation[:, :, 1], torch.zeros_like(translation)], 1)
        covariance = covariance + ANGLE_SD**2 * axis.mT @ axis
    symmetric: NDArray[np.float64] = ((covariance + covariance.mT) / 2).numpy()
    return symmetric


def rotation_offset(rotations: Tensor, rotation: Tensor, symmetry: Symmetry) -> Tensor:
    """Rotation vectors ω (N, 3) with turned = exp([ω]×) · rotation, in radians and the camera's axes.

    With symmetry ``"y"``, the smallest that takes one vertical axis to the other, across which it stands; with ``"y2"``
    to ``"y12"`` the smallest to a pose of the same look.

    Args:
        turned: (N, 3, 3).
        rotation: (N, 3, 3) or (1, 3, 3).
        symmetry: symmetry of the object.
    """
    if symmetry != "y":
        # Of the turns that leave the object unchanged the one that makes the vector shortest.
        turns = turns_about_y(num_turns(symmetry)).to(rotation)
        vectors = torch.stack([rotation_matrix_to_axis_angle(rotations @ turn @ rotation.mT) for turn in turns])
        shortest: Tensor = vectors.gather(0, vectors.norm(dim=2).argmin(0).view(1, -1, 1).expand(1, -1, 3))[0]
        return shortest
    up, to = rotation[..., 1].expand_as(rotations[..., 1]), rotations[..., 1]
    across = torch.linalg.cross(up, to)
    sine = across.norm(dim=1, keepdim=True)
    angle = torch.atan2(sine, (up * to).sum(1, keepdim=True))
    smallest: Tensor = across * torch.where(sine > 0, angle / sine, 1.0)
    return smallest


def size_log_sd(values: Variables, card: Card) -> float:
    """Return the standard deviation of the logarithm of the distance that is not determined by the picture.

    Where that is the category's mean size, a sixth of the logarithm of the ratio of its largest and smallest objects,
    which are taken to be three deviations from the mean.
    """
    if "distance" in values or "diagonal" in values:
        return DISTANCE_LOG_SD
    least, most = card.known.size_range
    return math.log(most / least) / 6


def _factor(values: Variables, card: Card) -> float:
    """The factor that the card's calibration of such fits measured."""
    known = card.calibration.get("RGB-D" if "distance" in values else "RGB")
    return UNMEASURED if known is None else known.covariance_factor


def _information(values: Variables, observation: Observation, draw: Callable[[Variables], Rendering]) -> Tensor:
    """Return JᵀJ / σ² (6, 6) of the drawing's pixels at the winner."""
    steps = torch.cat([torch.zeros(1, 6), torch.tensor(STEPS).diag()])
    drawn = draw(_moved(values, steps))
    residuals = _weighted(drawn.image - observation.image, observation.weight)
    if drawn.mask is not None and observation.mask is not None:
        residuals = torch.cat([residuals, _weighted(drawn.mask - observation.mask, observation.weight)], 1)
    residual, jacobian = (
        residuals[0],
        ((residuals[1:] - residuals[0]) / torch.tensor(STEPS, dtype=torch.float64)[:, None]),
    )
    counted = int(((residual != 0) | (jacobian != 0).any(0)).sum())
    variance = residual.square().sum() / max(1, counted - len(STEPS))
    # The least variance is that of 8-bit pictures.
    return jacobian @ jacobian.mT / variance.clamp_min(1 / 255**2)


def _weighted(difference: Tensor, weight: Tensor | None) -> Tensor:
    pixels = difference.double() if weight is None else torch.where(weight > 0, difference.double(), 0) * weight.sqrt()
    return pixels.flatten(1)


def _moved(values: Variables, steps: Tensor) -> Variables:
    """Return K rows of one problem's values after steps (K, 6), ordered as `STEPS`."""
    rows = {name: value.expand(len(steps), *value.shape[1:]) for name, value in values.items()}
    turns = axis_angle_to_rotation_matrix(steps[:, :3].double())
    angles = angles_from_rotation(fitted_rotations(values) @ turns)
    like = values["scale"]
    angles_by_name = {
        name: angle.to(like) for name, angle in zip(("azimuth", "elevation", "roll"), angles, strict=True)
    }
    steps = steps.to(like)
    return {
        **rows,
        **angles_by_name,
        "shift": rows["shift"] + steps[:, 3:5],
        "scale": rows["scale"] * steps[:, 5].exp(),
    }


def _zoomed(values: Variables, camera: Tensor, step: Tensor) -> tuple[Variables, Tensor]:
    """Return values and camera with the logarithm of the focal length increased by a step (1,)."""
    longer = camera.double().clone()
    longer[:2, :2] *= step.exp()
    return values | ({"focal": values["focal"] * step.exp()} if "focal" in values else {}), longer


def _central(function: Callable[[Tensor], Tensor], count: int, step: float = 1e-4) -> Tensor:
    """Return central derivatives (6, count) at 0 of offsets (K, 6) with respect to steps (K, count)."""
    steps = step * torch.eye(count, dtype=torch.float64)
    return ((function(steps) - function(-steps)) / (2 * step)).mT
