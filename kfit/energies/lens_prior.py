"""A prior on the focal length of a photo whose camera is unknown."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, ResidualPrior
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.geometry import distance_by_focal

# Standard deviation of the logarithm of focal lengths over the photo's longer side, about a median of 1.2 (the focal
# length that COLMAP and openMVG assume of an unknown camera): 95 % lie in [0.55, 2.6], from phones' main lenses (24 to
# 28 mm on film: 0.7 to 0.8) to portrait lenses (85 mm: 2.4).
FOCAL_SIGMA = 0.4
# 95 % of objects are photographed from 0.2 to 2 m: median in metres, and standard deviation of the logarithm.
DISTANCE, DISTANCE_SIGMA = 0.63, 0.58


class LensPrior(ResidualPrior):
    """Prior on the focal length of an unknown lens, and on the object's distance that follows from it.

    E = ½ (log(φ / φ₀) / 0.4)² + ½ (log(t / 0.63 m) / 0.58)², t = D · d(φ / scale)

    φ is the focal length over the picture's width, φ₀ that of the observation's intrinsics, D the category's mean box
    diagonal, and d the function `kfit.geometry.distance_by_focal`. The second term is needed because a short focal
    length puts an object that fills the photo nearer than people hold a camera.

    Shape: focal and scale (N,), energy (N,).

    Args:
        diagonal: D in metres.
        unit_fraction: fraction of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Raises:
        ValueError: if ``diagonal`` is not above 0, ``unit_fraction`` is outside [0.1, 10] or, when a fit starts, the
            observation has no intrinsics.

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> from kfit.energies import LensPrior
        >>> prior = LensPrior(diagonal=0.15, unit_fraction=0.5)
        >>> intrinsics = torch.tensor([[[1.2 * 64, 0, 31.5], [0, 1.2 * 64, 31.5], [0, 0, 1]]])
        >>> prepared = prior.prepare(Observation(torch.ones(1, 3, 64, 64), intrinsics=intrinsics))
        >>> focal = torch.tensor([0.6, 1.2, 2.4])
        >>> prior({"focal": focal, "scale": torch.ones(3)}, prepared.expand(3))
        tensor([3.5455, 0.4308, 1.5301])
    """

    on = ("focal", "scale")

    def __init__(self, diagonal: float, unit_fraction: float) -> None:
        super().__init__()
        check_arguments(LensPrior, locals(), diagonal=(check_positive,), unit_fraction=(0.1, 10.0))
        self.diagonal, self.unit_fraction = diagonal, unit_fraction

    def prepare(self, observation: Observation) -> Tensor:
        intrinsics = observation.field("intrinsics")
        return (intrinsics[:, 0, 0] + intrinsics[:, 1, 1]) / 2 / observation.image.shape[-1]

    def residuals(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        away = self.diagonal * distance_by_focal(value["focal"] / value["scale"], self.unit_fraction)
        lens = (value["focal"] / prepared).log() / FOCAL_SIGMA
        return torch.stack([lens, (away / DISTANCE).log() / DISTANCE_SIGMA], 1) / 2**0.5
