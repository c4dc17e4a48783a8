"""A prior on the focal length of a photo whose camera is unknown."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, ResidualPrior
from kfit.core.check import check_positive, check_range
from kfit.geometry import distance_by_focal

# Standard deviation of the logarithm of focal lengths over the photo's longer side, about a median of 1.2 (the focal
# length that COLMAP and openMVG assume of an unknown camera): 95 % lie in [0.55, 2.6], from phones' main lenses (24 to
# 28 mm on film: 0.7 to 0.8) to portrait lenses (85 mm: 2.4).
FOCAL_SPREAD = 0.4
# Objects are photographed from 0.2 to 2 m (95 %): median in metres, and standard deviation of the logarithm.
DISTANCE, DISTANCE_SPREAD = 0.63, 0.58


class LensPrior(ResidualPrior):
    """How unlikely a focal length is among those of lenses, and by the distance at which it has the object.

    E = ½ (log(φ / φ₀) / 0.4)² + ½ (log(t / 0.63 m) / 0.58)², t = D · d(φ / scale)

    with φ the focal length over the picture's width, φ₀ that of the observation's intrinsics, D the category's mean box
    diagonal, and d the function `kfit.geometry.distance_by_focal`. A short lens would have an object that fills the
    photo stand nearer than people hold a camera.

    Shape: focal and scale (N,), energy (N,).

    Args:
        diagonal: D in metres.
        unit_fraction: share of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Raises:
        ValueError: for a diagonal that is not above 0, a fraction outside [0.1, 10] and, when a fit starts, for an
            observation without intrinsics.
    """

    on = ("focal", "scale")

    def __init__(self, diagonal: float, unit_fraction: float) -> None:
        super().__init__()
        check_positive("LensPrior: diagonal", diagonal)
        check_range("LensPrior: unit_fraction", unit_fraction, 0.1, 10.0)
        self.diagonal, self.unit_fraction = diagonal, unit_fraction

    def prepare(self, observation: Observation) -> Tensor:
        intrinsics = observation.field("intrinsics")
        return (intrinsics[:, 0, 0] + intrinsics[:, 1, 1]) / 2 / observation.image.shape[-1]

    def residuals(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        away = self.diagonal * distance_by_focal(value["focal"] / value["scale"], self.unit_fraction)
        lens = (value["focal"] / prepared).log() / FOCAL_SPREAD
        return torch.stack([lens, (away / DISTANCE).log() / DISTANCE_SPREAD], 1) / 2**0.5
