"""Distributions over even bins of azimuth and elevation."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import log_softmax


def log_shares(
    azimuth: Tensor, elevation: Tensor, azimuths: Tensor, elevations: Tensor, spread: float
) -> tuple[Tensor, Tensor]:
    """Logarithms of a von Mises distribution in azimuth (N, A) and a Gaussian in elevation (N, E), over bins.

    κ = 1 / spread² and σ = spread about the given angles; each sums to 1 over its bins, a single bin has all.

    Args:
        azimuth, elevation: (N,) in radians.
        azimuths, elevations: (A,) and (E,) centres of the bins in radians.
        spread: in radians.
    """
    turned = (torch.cos(azimuth[:, None] - azimuths) - 1) / spread**2
    tipped = -0.5 * ((elevation[:, None] - elevations) / spread).square()
    return log_softmax(turned, 1), log_softmax(tipped, 1)
