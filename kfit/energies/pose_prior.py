"""A prior on rotations from a pose network's output for the picture."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation, Prior, frozen
from kfit.core.arguments import check_arguments
from kfit.geometry.pose_network import PoseNetwork


class PosePrior(Prior):
    """Distance of a rotation from a pose network's distribution over rotations for the picture.

    E = −log((1 − ε) · F + ε),  F = (Σ_b √(p_b q_b))²

    over the bins b of the network: p is its output for the picture, q its target for a picture of the rotation
    (`kfit.geometry.PoseNetwork.log_kernel`), and F the fidelity of the two, 1 where p = q: their Bhattacharyya
    coefficient squared (Bhattacharyya 1943). Around the pose of a confident network E is Δ² / 4σ². Several peaks share
    the probability between them. ε bounds the cost of a network that is wrong.

    Shape: azimuth, elevation and roll (N,) in radians, energy (N,) between 0 and −log ε.

    Args:
        head: image (N, C, H, W) → log-probabilities (N, B).
        floor: ε, in [1e-6, 0.5].

    Raises:
        ValueError: if ``floor`` is outside [1e-6, 0.5].

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> from kfit.energies import PosePrior
        >>> from kfit.generators import PoseHead
        >>> prior = PosePrior(PoseHead().eval())
        >>> prepared = prior.prepare(Observation(torch.rand(1, 3, 64, 64)))
        >>> angles = {"azimuth": torch.tensor([0.0]), "elevation": torch.tensor([0.3]), "roll": torch.tensor([0.0])}
        >>> energy = prior(angles, prepared)
        >>> energy.shape, bool(energy < -torch.log(torch.tensor(1e-3)))
        (torch.Size([1]), True)
    """

    on = ("azimuth", "elevation", "roll")

    def __init__(self, head: PoseNetwork, floor: float = 1e-3) -> None:
        super().__init__()
        check_arguments(PosePrior, locals(), floor=(1e-6, 0.5))
        self.head, self.floor = frozen(head), floor

    def prepare(self, observation: Observation) -> Tensor:
        return (self.head.log_probabilities(observation) / 2).exp()

    def forward(self, value: dict[str, Tensor], prepared: Any = None) -> Tensor:
        kernel = self.head.log_kernel(value["azimuth"], value["elevation"], value["roll"])
        fidelity = (prepared * (kernel / 2).exp()).sum(1).square()
        return -torch.log((1 - self.floor) * fidelity + self.floor)
