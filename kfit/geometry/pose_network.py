"""The contract of networks that read poses off pictures."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from torch import Tensor, nn


class PoseNetwork(nn.Module, ABC):
    """Looks at pictures and says how likely they show their objects at each azimuth and elevation.

    Attributes:
        azimuths, elevations: (A,) and (E,) centres of its bins in radians, rising in even steps; A is 1 where the
            object looks the same at all azimuths.
        sigma: standard deviation in radians of what it says around a pose of which it is sure.
    """

    azimuths: Tensor
    elevations: Tensor
    sigma: float = math.radians(6)

    @abstractmethod
    def forward(self, image: Tensor) -> Tensor:
        """Log-probabilities (N, A, E) of the bins, from RGB (N, 3, S, S) in [0, 1] on white."""
