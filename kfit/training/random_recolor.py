"""Augmentation of colours."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core.arguments import check_arguments


class RandomRecolor:
    """Mix the channels of pictures at random and change their gamma; white stays white.

    c' = (M c)^γ, the rows of M random and of sum 1 in half of the pictures, M = 1 in the others, and
    ln γ normal.

    Args:
        gamma: standard deviation of ln γ.

    Raises:
        ValueError: if ``gamma`` is negative.
    """

    def __init__(self, gamma: float = 0.5) -> None:
        check_arguments(RandomRecolor, locals(), gamma=(0, 3))
        self.gamma = gamma

    def __call__(self, image: Tensor) -> Tensor:
        """(N, 3, S, S) in [0, 1] → the same, each picture its own way, drawn from torch's random numbers."""
        rows = len(image)
        shares = (torch.rand(rows, 3, 3, device=image.device, dtype=image.dtype) + 0.05).square()
        shares = shares / shares.sum(2, keepdim=True)
        kept = torch.rand(rows, 1, 1, device=image.device) < 0.5
        mix = torch.where(kept, torch.eye(3, device=image.device, dtype=image.dtype), shares)
        bend = torch.exp(self.gamma * torch.randn(rows, 1, 1, 1, device=image.device, dtype=image.dtype))
        return torch.einsum("nij,njhw->nihw", mix, image).clamp(0, 1) ** bend
