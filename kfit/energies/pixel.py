"""Pixel by pixel: mean absolute and mean squared difference."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from kfit.core import Energy, ResidualEnergy
from kfit.core.check import check_shape
from kfit.energies.weighting import normalized_weights


class L1(Energy):
    """Mean absolute difference of two pictures.

    E = Σ_p w_p · mean_c |x_pc − y_pc| / Σ_p w_p, in [0, 1] for pictures in [0, 1].

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,).

    Raises:
        ValueError: if the pictures' shapes differ.
    """

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target: Tensor = prepared["target"]
        check_shape("prediction", prediction, tuple(target.shape))
        share = normalized_weights(prepared.get("weight"), target)
        error: Tensor = (prediction - target).abs() * share
        return error.sum((1, 2, 3))


class L2(ResidualEnergy):
    """Mean squared difference of two pictures.

    E = Σ_p w_p · mean_c (x_pc − y_pc)² / Σ_p w_p, in [0, 1] for pictures in [0, 1].

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,), residuals (N, C·H·W).

    Raises:
        ValueError: if the pictures' shapes differ.
    """

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        target: Tensor = prepared["target"]
        check_shape("prediction", prediction, tuple(target.shape))
        share = normalized_weights(prepared.get("weight"), target)
        residuals: Tensor = (prediction - target) * share.sqrt()
        return residuals.flatten(1)
