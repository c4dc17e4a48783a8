"""Mean absolute and mean squared difference by pixel."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from kfit.core import Energy, ResidualEnergy
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, normalized_weights, root_weights


class L1(Energy):
    """Mean absolute difference of two pictures.

    E = Σ_p w_p · mean_c |x_pc − y_pc| / Σ_p w_p, in [0, 1] for pictures in [0, 1].

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,); volumes (N, C, D, H, W) too.

    Raises:
        ValueError: if the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import L1
        >>> black, grey = torch.zeros(1, 3, 2, 2), torch.full((1, 3, 2, 2), 0.5)
        >>> L1()(black, grey)
        tensor([0.5000])
        >>> grey[..., 0] = 0.1
        >>> L1()(black, grey, weight=torch.tensor([[[[1.0, 0.0], [1.0, 0.0]]]]))  # the left column alone
        tensor([0.1000])
    """

    volumes = True

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        error: Tensor = (fill_background(prediction, weight) - target).abs() * normalized_weights(weight, target)
        return error.flatten(1).sum(1)


class L2(ResidualEnergy):
    """Mean squared difference of two pictures.

    E = Σ_p w_p · mean_c (x_pc − y_pc)² / Σ_p w_p, in [0, 1] for pictures in [0, 1].

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,), residuals (N, C·H·W); volumes
    (N, C, D, H, W) too.

    Raises:
        ValueError: if the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import L2
        >>> L2()(torch.zeros(2, 3, 4, 4), torch.full((2, 3, 4, 4), 0.5), reduction="sum")
        tensor(0.5000)
    """

    volumes = True

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        residuals: Tensor = (fill_background(prediction, weight) - target) * root_weights(weight, target)
        return residuals.flatten(1)
