"""A normal prior on a code."""

from __future__ import annotations

from torch import Tensor

from kfit.core import ResidualPrior
from kfit.core.arguments import check_arguments


class CodePrior(ResidualPrior):
    """Mean square of a code: the negative log-density, up to scale, of the standard normal that a VAE is trained with.

    E = mean_k z_k²

    Shape: code (N, K) or (N, \\*shape), energy (N,), about 1 for codes drawn from the prior.
    Source: the released code's ``1 · mean(z²)`` (neural_object_fitting at 7309348); the paper writes ‖z‖₂.

    Args:
        on: name of the variable.

    Example:
        >>> import torch
        >>> from kfit.energies import CodePrior
        >>> CodePrior()(torch.tensor([[0.0, 0.0], [1.0, 3.0]]))
        tensor([0.0000, 5.0000])
    """

    def __init__(self, on: str = "code") -> None:
        super().__init__()
        check_arguments(CodePrior, locals())
        self.on = on

    def residuals(self, value: Tensor, prepared: None = None) -> Tensor:
        flat = value.reshape(value.shape[0], -1)
        residuals: Tensor = flat / flat.shape[1] ** 0.5
        return residuals
