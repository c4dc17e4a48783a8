"""Distributions over even bins of azimuth and elevation."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import log_softmax


def bin_log_probabilities(
    azimuth: Tensor, elevation: Tensor, azimuths: Tensor, elevations: Tensor, sigma: float
) -> tuple[Tensor, Tensor]:
    """Logarithms of a von Mises distribution in azimuth (N, A) and a Gaussian in elevation (N, E), over bins.

    κ = 1 / spread² and σ = spread about the given angles; each sums to 1 over its bins, a single bin has all.

    Args:
        azimuth, elevation: (N,) in radians.
        azimuths, elevations: (A,) and (E,) centres of the bins in radians.
        sigma: in radians.
    """
    azimuth_logits = (torch.cos(azimuth[:, None] - azimuths) - 1) / sigma**2
    elevation_logits = -0.5 * ((elevation[:, None] - elevations) / sigma).square()
    return log_softmax(azimuth_logits, 1), log_softmax(elevation_logits, 1)
