"""A prior on rotations that a network reads off the picture."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, Prior, frozen
from kfit.core.check import check_range
from kfit.geometry.pose_network import PoseNetwork


class PosePrior(Prior):
    """Measures how far a rotation is from what a pose network reads off the picture.

    E = −log((1 − ε) · F + ε),  F = (Σ_b √(p_b q_b))²

    over the bins b of the network: p is its output for the picture, q its target for a picture of the rotation
    (`kfit.geometry.PoseNetwork.log_kernel`), and F the fidelity of the two, 1 where p = q: their Bhattacharyya
    coefficient squared (Bhattacharyya 1943). Around the pose of a confident network E is Δ² / 4σ². Of several peaks
    each has its share. ε bounds the cost of a network that is wrong.

    Shape: azimuth, elevation and roll (N,) in radians, energy (N,) between 0 and −log ε.

    Args:
        head: image (N, C, H, W) → log-probabilities (N, B).
        floor: ε.

    Raises:
        ValueError: for a floor outside [1e-6, 0.5].
    """

    on = ("azimuth", "elevation", "roll")

    def __init__(self, head: PoseNetwork, floor: float = 1e-3) -> None:
        super().__init__()
        check_range("PosePrior: floor", floor, 1e-6, 0.5)
        self.head, self.floor = frozen(head), floor

    def prepare(self, observation: Observation) -> Tensor:
        return (self.head.log_probabilities(observation) / 2).exp()

    def forward(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        kernel = self.head.log_kernel(value["azimuth"], value["elevation"], value["roll"])
        fidelity = (prepared * (kernel / 2).exp()).sum(1).square()
        return -torch.log((1 - self.floor) * fidelity + self.floor)
