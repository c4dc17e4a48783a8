"""Outline against outline."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Energy
from kfit.core.check import check_shape
from kfit.energies.pixel import L2
from kfit.energies.weighting import fill_background, normalized_weights


class Silhouette(L2):
    """Mean squared difference of two masks: `L2` on "mask".

    Shape: masks (N, 1, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in [0, 1].
    """

    on = "mask"


class SoftIoU(Energy):
    """How far two masks are from covering the same pixels, whatever the object's size in the picture.

    E = 1 − Σ w · min(a, b) / Σ w · max(a, b); two empty masks agree, E = 0.

    Shape: masks (N, 1, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in [0, 1].

    Raises:
        ValueError: if the masks' shapes differ.
    """

    on = "mask"

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        prediction, share = fill_background(prediction, weight), normalized_weights(weight, target)
        union = (torch.maximum(prediction, target) * share).sum((1, 2, 3))
        # max − min = |a − b|: the difference of two sums would round to something below 0 at the truth
        apart: Tensor = ((prediction - target).abs() * share).sum((1, 2, 3))
        return apart / torch.where(union > 0, union, 1)
