"""Blocks of the networks that read poses off pictures."""

from __future__ import annotations

from torch import Tensor, nn


def convolution(a: int, b: int, stride: int) -> nn.Sequential:
    """Return a 3 × 3 convolution from a to b channels with normalisation and activation."""
    # The normalisation has the bias.
    return nn.Sequential(nn.Conv2d(a, b, 3, stride, 1, bias=False), nn.BatchNorm2d(b), nn.LeakyReLU(0.2))


class Residual(nn.Module):
    """Adds a convolution's output to its input (N, dim, H, W)."""

    def __init__(self, dim: int) -> None:
        super().__init__()
        self.change = convolution(dim, dim, 1)

    def forward(self, x: Tensor) -> Tensor:
        changed: Tensor = x + self.change(x)
        return changed
