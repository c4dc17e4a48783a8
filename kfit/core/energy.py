"""The contract of what compares drawing and observation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from torch import Tensor, nn

from kfit.core.part import Part
from kfit.core.pictures import Reduction, at_least_single, check_prediction, check_target, precision_of, reduced


class Energy(Part, nn.Module, ABC):
    """Measures how badly a prediction explains a target: one number a row, lower is better.

    It compares two tensors, so it serves any task and needs no pipeline.

    Attributes:
        on: field(s) of rendering and observation that a pipeline passes; with a tuple it passes dicts of tensors.
        mixed: whether it is evaluated under ``torch.autocast`` in a fit under autocast, which speeds up convolutions of
            many channels. Other energies would lose precision, and are evaluated without autocast.
        volumes: whether it compares volumes (N, C, D, H, W) too.
        unit_range: whether it is meaningful for targets in [0, 1] alone.

    Example:
        >>> import torch, kfit
        >>> class Brightness(kfit.Energy):
        ...     def compare(self, prediction: torch.Tensor, prepared: dict) -> torch.Tensor:
        ...         return (prediction - prepared["target"]).mean((1, 2, 3)).abs()
        >>> Brightness()(torch.zeros(2, 3, 8, 8), torch.full((2, 3, 8, 8), 0.25))
        tensor([0.2500, 0.2500])
    """

    on: str | tuple[str, ...] = "image"
    mixed: bool = False
    volumes: bool = False
    unit_range: bool = False
    __call__: Callable[..., Tensor]

    def check(self, target: Any, weight: Tensor | None = None) -> None:
        """Refuse, with TypeError or ValueError, targets it cannot compare; called once a fit, and in each `forward`."""
        check_target(target, weight, self.volumes, self.unit_range)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        """Compute what depends on the target alone, once a fit: a pytree of tensors that lead with rows.

        Args:
            target: (N, C, H, W), or a dict of such if ``on`` is a tuple.
            weight: (N, 1, H, W) or None; 0 excludes a pixel, even if it is NaN. In a fit it is the product of the
                observation's weight and the rendering's.
        """
        return {"target": target} if weight is None else {"target": target, "weight": weight}

    @abstractmethod
    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        """Return energies (N,) of N predictions and N prepared targets."""

    def forward(
        self, prediction: Any, target: Any, weight: Tensor | None = None, reduction: Reduction = "none"
    ) -> Tensor:
        """Return ``compare(prediction, prepare(target, weight))`` of checked inputs, for other tasks such as training.

        Under ``torch.autocast`` it computes in single precision, unless it is ``mixed``. ``reduction`` "none" returns
        energies (N,), "mean" and "sum" one number.
        """
        self.check(target, weight)
        check_prediction(prediction, target, self.volumes)
        prediction, target = at_least_single((prediction, target))
        with precision_of(target, self.mixed):
            return reduced(self.compare(prediction, self.prepare(target, weight)), reduction)


class ResidualEnergy(Energy):
    """An energy that is a mean of squares: E = Σ_m r_m².

    Example:
        >>> import torch, kfit
        >>> class MeanSquare(kfit.ResidualEnergy):
        ...     def residuals(self, prediction: torch.Tensor, prepared: dict) -> torch.Tensor:
        ...         difference = (prediction - prepared["target"]).flatten(1)
        ...         return difference / difference.shape[1] ** 0.5
        >>> MeanSquare()(torch.zeros(1, 3, 8, 8), torch.full((1, 3, 8, 8), 0.5))
        tensor([0.2500])
    """

    @abstractmethod
    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        """Return residuals (N, M) whose squares sum to the energy."""

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        return self.residuals(prediction, prepared).square().sum(1)
