"""A prior on poses that a network reads off the picture."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, PoseNetwork, Prior, frozen
from kfit.core.check import check_range
from kfit.geometry import log_shares


class PosePrior(Prior):
    """Negative log-density of azimuth and elevation by a pose head's look at the picture.

    E = −log((1 − ε) · Σ_b p_b K(pose, b) + ε),  K = exp((cos Δazimuth − 1) / s²) · exp(−Δelevation² / 2s²)

    over the bins b of the head, where p_b is what it says, K is made to sum to 1 over the bins, and s is a bin's width.
    A head that is wrong is outvoted at a bounded cost: ε takes the part of all poses alike.

    Shape: azimuth and elevation (N,) in radians, energy (N,) between 0 and −log ε.

    Args:
        head: image (N, C, H, W) → log-probabilities (N, A, E).
        floor: ε.

    Raises:
        ValueError: for a floor outside [1e-6, 0.5].
    """

    on = ("azimuth", "elevation")

    def __init__(self, head: PoseNetwork, floor: float = 1e-3) -> None:
        super().__init__()
        check_range("PosePrior: floor", floor, 1e-6, 0.5)
        self.head, self.floor = frozen(head), floor

    def prepare(self, observation: Observation) -> Tensor:
        said: Tensor = self.head(observation.image)
        return said.exp()

    def forward(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        azimuths, elevations = self.head.azimuths, self.head.elevations
        width = float(elevations[1] - elevations[0]) if len(elevations) > 1 else math.pi
        turned, tipped = log_shares(value["azimuth"], value["elevation"], azimuths, elevations, width)
        near = torch.einsum("nae,na,ne->n", prepared, turned.exp(), tipped.exp())
        return -torch.log((1 - self.floor) * near + self.floor)
