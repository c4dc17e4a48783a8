"""The contract of what is known of variables before, or by the picture as a whole."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from torch import Tensor, nn

from kfit.core.observation import Observation
from kfit.core.part import Part


class Prior(Part, nn.Module, ABC):
    """Measures how unlikely values of variables are, in general or for the observed picture: one number a row.

    Attributes:
        on: name of the variable; with a tuple of names it takes a dict.

    Example:
        >>> import torch, kfit
        >>> class Upright(kfit.Prior):
        ...     on = "roll"
        ...
        ...     def forward(self, value: torch.Tensor, prepared: None = None) -> torch.Tensor:
        ...         return 1 - value.cos()
        >>> Upright()(torch.tensor([0.0, 3.1416]))
        tensor([0., 2.])
    """

    on: str | tuple[str, ...]
    __call__: Callable[..., Tensor]

    def prepare(self, observation: Observation) -> Any:
        """Compute what depends on the picture alone, once a fit: tensors that lead with rows, or None."""
        return None

    @abstractmethod
    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        """Return energies (N,) of N values (N, \\*shape), with the result of `prepare` if it is not None."""


class ResidualPrior(Prior):
    """A prior that is a sum of squares: E = Σ_m r_m².

    Example:
        >>> import torch, kfit
        >>> class Small(kfit.ResidualPrior):
        ...     on = "shift"
        ...
        ...     def residuals(self, value: torch.Tensor, prepared: None = None) -> torch.Tensor:
        ...         return value
        >>> Small()(torch.tensor([[3.0, 4.0]]))
        tensor([25.])
    """

    @abstractmethod
    def residuals(self, value: Any, prepared: Any = None) -> Tensor:
        """Return residuals (N, M) whose squares sum to the energy."""

    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        return self.residuals(value, prepared).square().sum(1)
