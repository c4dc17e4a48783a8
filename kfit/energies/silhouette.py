"""Energies of masks."""

from __future__ import annotations

from abc import abstractmethod
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

    Example:
        >>> import torch
        >>> from kfit.energies import Silhouette
        >>> Silhouette()(torch.tensor([[[[0.0, 0.5, 1.0, 1.0]]]]), torch.tensor([[[[0.0, 0.0, 1.0, 1.0]]]]))
        tensor([0.0625])
    """

    on = "mask"
    unit_range = True


class _Overlap(Energy):
    """Compares two masks by sums over their pixels; the ground of a volume or picture that does not count is filled."""

    on = "mask"
    volumes = True
    unit_range = True

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    @abstractmethod
    def overlap(self, prediction: Tensor, target: Tensor, share: Tensor) -> Tensor:
        """Energies (N,) of masks (N, 1, …) and the share of each pixel."""

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        return self.overlap(fill_background(prediction, weight), target, normalized_weights(weight, target))


class SoftIoU(_Overlap):
    """One minus the soft intersection over union of two masks, whatever the size of the object.

    E = 1 − Σ w · min(a, b) / Σ w · max(a, b); two empty masks agree, E = 0.

    Shape: masks (N, 1, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in [0, 1]; volumes (N, 1, D, H, W) too.

    Raises:
        ValueError: if the masks' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import SoftIoU
        >>> SoftIoU()(torch.tensor([[[[0.0, 1.0, 1.0, 0.0]]]]), torch.tensor([[[[0.0, 0.0, 1.0, 1.0]]]]))
        tensor([0.6667])
    """

    def overlap(self, prediction: Tensor, target: Tensor, share: Tensor) -> Tensor:
        union = (torch.maximum(prediction, target) * share).flatten(1).sum(1)
        # max − min = |a − b|: the difference of two sums would round to something below 0 at the truth
        apart: Tensor = ((prediction - target).abs() * share).flatten(1).sum(1)
        return apart / torch.where(union > 0, union, 1)


class Dice(_Overlap):
    """One minus the soft Dice coefficient of two masks.

    E = 1 − 2 Σ w·a·b / (Σ w·a² + Σ w·b²) = Σ w·(a − b)² / (Σ w·a² + Σ w·b²); two empty masks agree, E = 0. The squares
    in the denominator make E 0 for equal soft masks.

    Shape: masks (N, 1, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in [0, 1]; volumes (N, 1, D, H, W) too.
    Source: Milletari, Navab and Ahmadi, V-Net, 2016; Dice, 1945.

    Raises:
        ValueError: if the masks' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import Dice
        >>> Dice()(torch.tensor([[[[0.0, 1.0]]]]), torch.ones(1, 1, 1, 2))
        tensor([0.3333])
    """

    def overlap(self, prediction: Tensor, target: Tensor, share: Tensor) -> Tensor:
        size = ((prediction.square() + target.square()) * share).flatten(1).sum(1)
        apart: Tensor = ((prediction - target).square() * share).flatten(1).sum(1)
        return apart / torch.where(size > 0, size, 1)
