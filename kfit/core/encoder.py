"""The contract of networks that read codes off pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from torch import Tensor, nn


class Encoder(nn.Module, ABC):
    """Predicts which codes could have drawn a picture.

    Example:
        >>> import torch
        >>> from kfit.generators import ConvEncoder
        >>> mean, log_variance = ConvEncoder(code_dim=8)(torch.rand(2, 3, 64, 64))
        >>> mean.shape
        torch.Size([2, 8])
    """

    __call__: Callable[..., tuple[Tensor, Tensor]]

    @abstractmethod
    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and log-variance (N, D) of a Gaussian over the code, from RGB (N, 3, S, S) in [0, 1] on white."""
