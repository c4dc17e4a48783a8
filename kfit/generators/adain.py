"""Adaptive instance normalisation: how a code speaks to a layer."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F


class AdaIN(nn.Module):
    """Replaces each channel's mean and spread by those that the code asks for (Huang and Belongie 2017).

    y = σ(z) · (x − mean(x)) / √(var(x) + 1e-5) + μ(z), where (μ, σ) = A z + b; mean and (biased) variance are
    taken over a sample's pixels or voxels.

    Args:
        num_channels: C.
        code_dim: D.
        rectified: (μ, σ) = relu(A z + b), as in the released code.
        gain: standard deviation of A's elements before training: how loud codes speak at first.
    """

    def __init__(self, num_channels: int, code_dim: int, rectified: bool = False, gain: float = 0.1) -> None:
        super().__init__()
        self.rectified = rectified
        self.affine = nn.Linear(code_dim, 2 * num_channels)
        nn.init.normal_(self.affine.weight, std=gain)
        # Begins near the identity, with every ReLU open.
        nn.init.constant_(self.affine.bias[:num_channels], 0.1)
        nn.init.ones_(self.affine.bias[num_channels:])

    def style(self, code: Tensor) -> Tensor:
        """(N, 2C): the means, then the spreads, that codes (N, D) ask for."""
        style: Tensor = self.affine(code)
        return F.relu(style) if self.rectified else style

    def forward(self, features: Tensor, style: Tensor) -> Tensor:
        """Restyle features (N, C, …) by styles (N, 2C)."""
        mean, std = style.view(*style.shape, *[1] * (features.dim() - 2)).chunk(2, 1)
        return F.instance_norm(features) * std + mean
