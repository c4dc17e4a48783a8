"""A pose network that gives the same log-probabilities whatever it sees."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.geometry import PoseNetwork, Symmetry


class FixedHead(PoseNetwork):
    """Bins of ``bin_deg``; without rolls it is upright, as the heads of kfit 0.1 are."""

    def __init__(
        self, symmetry: Symmetry = "none", bin_deg: float = 12.0, has_roll: bool = True, sigma_deg: float = 7.0
    ) -> None:
        count = round(360 / bin_deg)
        turns = 2 * math.pi * torch.arange(count) / count
        elevations = math.pi * ((torch.arange(count // 2) + 0.5) / (count // 2) - 0.5)
        super().__init__(
            rolls=turns if has_roll else torch.zeros(1),
            azimuths=torch.zeros(1) if symmetry == "y" else turns,
            elevations=elevations,
            symmetry=symmetry,
            sigma=math.radians(sigma_deg),
        )
        self.register_buffer("logits", self.log_volume.clone())
        self.calls = 0

    def certain_of(self, *poses: tuple[float, float, float], weights: tuple[float, ...] = (1.0,)) -> FixedHead:
        """Sets a mixture of kernels around (azimuth, elevation, roll) in degrees; returns itself."""
        angles = torch.tensor(poses).deg2rad().unbind(1)
        mixture = self.log_kernel(*angles).exp() * torch.tensor(weights)[:, None]
        self.logits = (mixture.sum(0) / sum(weights)).clamp_min(1e-20).log()
        return self

    def forward(self, image: Tensor) -> Tensor:
        self.calls += 1
        return self.logits.log_softmax(0).expand(len(image), -1)
