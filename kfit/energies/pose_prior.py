"""A prior on poses that a network reads off the picture."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, Prior, frozen
from kfit.core.check import check_range
from kfit.geometry import PoseNetwork, bin_log_probabilities


class PosePrior(Prior):
    """How far a pose is from what a pose head reads off the picture.

    E = −log((1 − ε) · F + ε),  F = (Σ_b √(p_b q_b))²

    over the bins b of the head: p is what it says, q what it would say if it were sure of the pose, a von Mises
    distribution in azimuth times a Gaussian in elevation (`kfit.geometry.bin_log_probabilities`), and F the fidelity of
    the two, 1 where p = q: their Bhattacharyya coefficient squared (Bhattacharyya 1943). Around a sure head's pose E is
    Δ² / 4 sigma², at the edges of its range too, where bins end; of several peaks each has its share. A head that is
    wrong is outvoted at a bounded cost: ε takes the part of all poses alike.

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
        return (said / 2).exp()

    def forward(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        azimuths, elevations = self.head.azimuths, self.head.elevations
        log_azimuth, log_elevation = bin_log_probabilities(
            value["azimuth"], value["elevation"], azimuths, elevations, self.head.sigma
        )
        alike = torch.einsum("nae,na,ne->n", prepared, (log_azimuth / 2).exp(), (log_elevation / 2).exp()).square()
        return -torch.log((1 - self.floor) * alike + self.floor)
