"""The contract of networks that read codes off pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from torch import Tensor, nn


class Encoder(nn.Module, ABC):
    """Looks at pictures and says which codes could have drawn them."""

    __call__: Callable[..., tuple[Tensor, Tensor]]

    @abstractmethod
    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance (N, D) of a Gaussian over the code, from RGB (N, 3, S, S) in [0, 1] on white."""
