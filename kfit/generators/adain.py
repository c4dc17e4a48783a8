"""Adaptive instance normalisation: a code sets the statistics of a layer."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F


class AdaIN(nn.Module):
    """Replace each channel's mean and standard deviation by those that a code prescribes (Huang and Belongie 2017).

    y = σ(z) · (x − mean(x)) / √(var(x) + 1e-5) + μ(z), where (μ, σ) = A z + b; mean and (biased) variance are
    taken over a sample's pixels or voxels.

    Args:
        num_channels: C.
        code_dim: D.
        rectified: (μ, σ) = relu(A z + b), as in the released code.
        gain: standard deviation of A's elements before training, which sets how much codes matter at first.
    """

    def __init__(self, num_channels: int, code_dim: int, rectified: bool = False, gain: float = 0.1) -> None:
        super().__init__()
        self.rectified = rectified
        self.affine = nn.Linear(code_dim, 2 * num_channels)
        nn.init.normal_(self.affine.weight, std=gain)
        # Starts near the identity, with every ReLU active.
        nn.init.constant_(self.affine.bias[:num_channels], 0.1)
        nn.init.ones_(self.affine.bias[num_channels:])

    def style(self, code: Tensor) -> Tensor:
        """Return styles (N, 2C) of codes (N, D): the means, then the standard deviations."""
        style: Tensor = self.affine(code)
        return F.relu(style) if self.rectified else style

    def forward(self, features: Tensor, style: Tensor) -> Tensor:
        """Apply styles (N, 2C) to features (N, C, …)."""
        mean, std = style.view(*style.shape, *[1] * (features.dim() - 2)).chunk(2, 1)
        return F.instance_norm(features) * std + mean
