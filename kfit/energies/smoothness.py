"""Priors on the roughness of a field: total variation and bending energy."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Prior, ResidualPrior
from kfit.core.arguments import check_arguments
from kfit.core.pictures import at_least_single, check_pictures


class TotalVariation(Prior):
    """Mean absolute difference of neighbours in a picture, a volume or a flow field; a jump costs no more than a ramp.

    E = Σ_i mean |∂_i z|, over the spatial axes i, with differences of neighbours and the mean over channels and places.
    It equals Kornia's ``total_variation`` with its mean, averaged over channels.

    Shape: field (N, C, H, W) or (N, C, D, H, W), energy (N,) in the field's unit per pixel.
    Source: Rudin, Osher and Fatemi, Nonlinear total variation based noise removal algorithms, 1992 (anisotropic).

    Args:
        on: name of the variable.

    Raises:
        ValueError: if the field has another number of axes.

    Example:
        >>> import torch
        >>> from kfit.energies import TotalVariation
        >>> TotalVariation("flow")(torch.eye(2).view(1, 1, 2, 2))
        tensor([2.])
    """

    def __init__(self, on: str) -> None:
        super().__init__()
        check_arguments(TotalVariation, locals())
        self.on = on

    def forward(self, value: Any, prepared: None = None) -> Tensor:
        field = _checked(self.on, value, 2)
        parts = [field.diff(dim=axis).abs().flatten(1).mean(1) for axis in range(2, field.dim())]
        return torch.stack(parts).sum(0)


class BendingEnergy(ResidualPrior):
    """Mean squared second derivative of a flow field; affine motions have energy 0.

    E = mean over inner places and channels of Σ_ij (∂_i ∂_j z)², with central differences of neighbours; mixed
    derivatives count twice.

    Shape: field (N, C, H, W) or (N, C, D, H, W), sides of at least 3; energy (N,) in the field's unit squared per
    pixel⁴; residuals (N, C · inner places · second derivatives).
    Source: Rueckert et al., Nonrigid registration using free-form deformations, 1999, eq. 6.

    Args:
        on: name of the variable.

    Raises:
        ValueError: if the field has another number of axes, or a side below 3.

    Example:
        >>> import torch
        >>> from kfit.energies import BendingEnergy
        >>> BendingEnergy("flow")(torch.arange(4.0).square().expand(1, 1, 4, 4))
        tensor([4.])
    """

    def __init__(self, on: str) -> None:
        super().__init__()
        check_arguments(BendingEnergy, locals())
        self.on = on

    def residuals(self, value: Any, prepared: None = None) -> Tensor:
        field = _checked(self.on, value, 3)
        axes, parts = range(2, field.dim()), []
        for first in axes:
            for second in axes[first - 2 :]:
                if first == second:
                    part = _inside(field.diff(n=2, dim=first), skip=first)
                else:
                    twice = _central(_central(field, first), second)
                    part = 2**0.5 * _inside(twice, skip=(first, second))
                parts.append(part.flatten(1) / part[0].numel() ** 0.5)
        return torch.cat(parts, 1)


def _central(field: Tensor, axis: int) -> Tensor:
    size = field.shape[axis]
    return (field.narrow(axis, 2, size - 2) - field.narrow(axis, 0, size - 2)) / 2


def _inside(field: Tensor, skip: int | tuple[int, ...]) -> Tensor:
    """Cut off a border of one pixel along the axes that differences have not shortened yet."""
    for axis in range(2, field.dim()):
        if axis not in (skip if isinstance(skip, tuple) else (skip,)):
            field = field.narrow(axis, 1, field.shape[axis] - 2)
    return field


def _checked(name: Any, field: Any, least_side: int) -> Tensor:
    check_pictures(str(name), field, volumes=True, least_side=least_side)
    checked: Tensor = at_least_single(field)
    return checked
