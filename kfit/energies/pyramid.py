"""Any energy, at several resolutions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import torch
from kornia.geometry.transform import pyrdown
from torch import Tensor

from kfit.core import Energy, ResidualEnergy
from kfit.core.arguments import check_arguments
from kfit.energies.weighting import fill_background


class Pyramid(Energy):
    """Mean of an energy over the levels of a Gaussian pyramid, which widens its basin of attraction.

    E = 1/L Σ_l e(x_l, y_l; w_l), where each level is Kornia's ``pyrdown`` of the one before: a 5×5 Gaussian and half
    the size, rounded down, with mirrored borders. Weights are reduced in the same way, and pictures premultiplied by
    them.

    Shape: as the energy's; H and W at least 3 · 2^(L − 2), and at the coarsest level as large as the energy needs.

    Args:
        energy: the energy of each level; it also decides which fields of a rendering are compared.
        num_levels: L; 1 is the picture alone.

    Raises:
        ValueError: if there are no levels, or the pictures are too small for them.

    Example:
        >>> import torch
        >>> from kfit.energies import L2, Pyramid
        >>> left, right = torch.zeros(2, 1, 1, 32, 32)
        >>> left[..., 4:8], right[..., 12:16] = 1.0, 1.0  # two bars that do not overlap
        >>> nearer = right.roll(-2, 3)
        >>> L2()(left, right), L2()(left, nearer)  # no slope to follow
        (tensor([0.2500]), tensor([0.2500]))
        >>> Pyramid(L2(), 4)(left, right), Pyramid(L2(), 4)(left, nearer)
        (tensor([0.1382]), tensor([0.1291]))
    """

    def __init__(self, energy: Energy, num_levels: int = 3) -> None:
        super().__init__()
        check_arguments(Pyramid, locals())
        self.energy, self.num_levels = energy, num_levels
        self.on, self.mixed, self.unit_range = energy.on, energy.mixed, energy.unit_range

    def check(self, target: Any, weight: Tensor | None = None) -> None:
        super().check(target, weight)
        for _ in range(self.num_levels - 1):
            target = _halved(target, weight)
            weight = None if weight is None else _pooled(weight)
        self.energy.check(target, weight)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        levels, weights = [], []
        for number in range(self.num_levels):
            if number:
                target = _halved(target, weight)
                weight = None if weight is None else _pooled(weight)
            levels.append(self.energy.prepare(target, weight))
            weights.append(weight)
        return {"levels": levels} if weight is None else {"levels": levels, "weights": weights}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        return torch.stack([self.energy.compare(*level) for level in self._levels(prediction, prepared)]).mean(0)

    def _levels(self, prediction: Any, prepared: Any) -> Iterator[tuple[Any, Any]]:
        """Prediction and prepared target of each level, the finest first."""
        for number, level in enumerate(prepared["levels"]):
            if number:
                prediction = _halved(prediction, prepared["weights"][number - 1] if "weights" in prepared else None)
            yield prediction, level


class ResidualPyramid(Pyramid, ResidualEnergy):
    """A `Pyramid` of a residual energy, with residuals itself.

    Shape: residuals (N, Σ_l M_l), those of each level divided by √L.

    Args:
        energy: an energy with residuals.
        num_levels: L; 1 is the picture alone.

    Example:
        >>> import torch
        >>> from kfit.energies import L2, ResidualPyramid
        >>> energy, target = ResidualPyramid(L2(), 2), torch.ones(1, 1, 8, 8)
        >>> energy.residuals(torch.zeros(1, 1, 8, 8), energy.prepare(target)).shape  # 64 + 16
        torch.Size([1, 80])
    """

    energy: ResidualEnergy

    def __init__(self, energy: ResidualEnergy, num_levels: int = 3) -> None:
        super().__init__(energy, num_levels)

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        found = [self.energy.residuals(*level) for level in self._levels(prediction, prepared)]
        return torch.cat(found, 1) / math.sqrt(self.num_levels)


def _halved(pictures: Any, weight: Tensor | None) -> Any:
    """Pictures (N, C, H, W), one or a dict of them, at half the size."""
    if isinstance(pictures, dict):
        return {name: _halved(picture, weight) for name, picture in pictures.items()}
    if weight is None:
        return _pooled(pictures)
    weight = weight.to(pictures.dtype)
    total = _pooled(weight)
    return _pooled(fill_background(pictures, weight) * weight) / torch.where(total > 0, total, 1)


def _pooled(picture: Tensor) -> Tensor:
    if min(picture.shape[-2:]) < 3:  # the border is mirrored by two pixels
        raise ValueError(f"num_levels is too large: a level of {tuple(picture.shape[-2:])} pixels has no half")
    half: Tensor = pyrdown(picture if picture.is_floating_point() else picture.float())
    return half
