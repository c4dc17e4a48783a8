"""Pixel by pixel: mean absolute and mean squared difference."""

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
    """

    volumes = True

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        residuals: Tensor = (fill_background(prediction, weight) - target) * root_weights(weight, target)
        return residuals.flatten(1)
