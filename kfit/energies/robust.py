"""Robust kernels: they grow more slowly than the square, so that a few wrong pixels do not dominate the fit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
import torch.nn.functional as F
from kornia.losses import cauchy_loss, charbonnier_loss, geman_mcclure_loss, welsch_loss
from torch import Tensor

from kfit.core import ResidualEnergy
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive, check_shape
from kfit.energies.weighting import fill_background, root_weights


class _Robust(ResidualEnergy):
    # ρ(u) of each number as loss(u, 0, reduction="none"), about u² / 2 where u is small
    loss: Callable[..., Tensor]

    volumes = True

    def __init__(self, scale: float = 0.1) -> None:
        super().__init__()
        check_arguments(type(self), locals(), scale=(check_positive,))
        self.scale = scale

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        root_share = root_weights(weight, target)
        u = ((fill_background(prediction, weight) - target) / self.scale).to(root_share.dtype)
        # r = ±√ρ is smooth, its formula is not: near 0, where ρ(u) = u² / 2, the root has no slope
        near = u.abs() < 1e-4
        far = torch.where(near, 1.0, u)
        root = self.loss(far, torch.zeros_like(u), reduction="none").sqrt() * far.sign()
        residuals: Tensor = torch.where(near, u * 0.5**0.5, root) * root_share
        return residuals.flatten(1)


class Charbonnier(_Robust):
    """Charbonnier energy: quadratic for small differences, linear for large ones, smooth in between.

    E = Σ_p w_p · mean_c ρ((x_pc − y_pc) / s) / Σ_p w_p, with ρ(u) = √(u² + 1) − 1.

    All kernels of this file are about u² / 2 for differences well below the scale s. They have residuals ±√ρ, so that
    least-squares optimizers can use them.

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,), residuals (N, C·H·W); volumes
    (N, C, D, H, W) too.
    Source: Charbonnier et al., 1994; α = 1 in Barron, A general and adaptive robust loss function, 2019.

    Args:
        scale: difference s, in picture units, above which the kernel grows more slowly than the square.

    Raises:
        ValueError: if ``scale`` is not above 0, or the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import Charbonnier
        >>> target = torch.tensor([0.0, 0.1, 1.0]).view(3, 1, 1, 1)
        >>> Charbonnier(scale=0.1)(torch.zeros(3, 1, 1, 1), target)
        tensor([0.0000, 0.4142, 9.0499])
    """

    loss = staticmethod(charbonnier_loss)


class Huber(_Robust):
    """Huber energy: quadratic below the scale, linear above it.

    As `Charbonnier`, with ρ(u) = u² / 2 for |u| ≤ 1 and |u| − 1/2 above.

    Source: Huber, Robust estimation of a location parameter, 1964.

    Args:
        scale: difference s, in picture units, above which it grows linearly.

    Example:
        >>> import torch
        >>> from kfit.energies import Huber
        >>> target = torch.tensor([0.0, 0.1, 1.0]).view(3, 1, 1, 1)
        >>> Huber(scale=0.1)(torch.zeros(3, 1, 1, 1), target)
        tensor([0.0000, 0.5000, 9.5000])
    """

    loss = staticmethod(F.huber_loss)


class Cauchy(_Robust):
    """Cauchy energy: logarithmic for large differences.

    As `Charbonnier`, with ρ(u) = log(1 + u² / 2).

    Source: Black and Anandan, 1996 (Lorentzian); α = 0 in Barron, 2019.

    Args:
        scale: difference s, in picture units, above which the kernel grows more slowly than the square.

    Example:
        >>> import torch
        >>> from kfit.energies import Cauchy
        >>> target = torch.tensor([0.0, 0.1, 1.0]).view(3, 1, 1, 1)
        >>> Cauchy(scale=0.1)(torch.zeros(3, 1, 1, 1), target)
        tensor([0.0000, 0.4055, 3.9318])
    """

    loss = staticmethod(cauchy_loss)


class GemanMcClure(_Robust):
    """Geman–McClure energy: bounded by 2 for arbitrarily large differences.

    As `Charbonnier`, with ρ(u) = 2u² / (u² + 4).

    Source: Geman and McClure, 1985; α = −2 in Barron, 2019.

    Args:
        scale: difference s, in picture units, above which the kernel grows more slowly than the square.

    Example:
        >>> import torch
        >>> from kfit.energies import GemanMcClure
        >>> target = torch.tensor([0.0, 0.1, 1.0]).view(3, 1, 1, 1)
        >>> GemanMcClure(scale=0.1)(torch.zeros(3, 1, 1, 1), target)
        tensor([0.0000, 0.4000, 1.9231])
    """

    loss = staticmethod(geman_mcclure_loss)


class Welsch(_Robust):
    """Welsch energy: bounded by 1, which it reaches faster than `GemanMcClure` its bound.

    As `Charbonnier`, with ρ(u) = 1 − exp(−u² / 2).

    Source: Dennis and Welsch, 1978; α → −∞ in Barron, 2019.

    Args:
        scale: difference s, in picture units, above which the kernel grows more slowly than the square.

    Example:
        >>> import torch
        >>> from kfit.energies import Welsch
        >>> target = torch.tensor([0.0, 0.1, 1.0]).view(3, 1, 1, 1)
        >>> Welsch(scale=0.1)(torch.zeros(3, 1, 1, 1), target)
        tensor([0.0000, 0.3935, 1.0000])
    """

    loss = staticmethod(welsch_loss)
