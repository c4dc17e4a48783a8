"""Energies and priors as functions, for one call without a module.

Each function takes the inputs of its class, then the class's settings by name, and returns energies (N,):

>>> import torch
>>> from kfit.energies import functional
>>> x, y = torch.zeros(2, 3, 16, 16), torch.ones(2, 3, 16, 16)
>>> functional.ssim(x, y, window_size=7, reduction="mean")
tensor(0.4999)
>>> functional.code_prior(torch.tensor([[1.0, 3.0]]))
tensor([5.0000])

Classes that hold networks, such as `kfit.energies.LPIPS`, are costly to build: build them once and call them instead.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any, Protocol

from torch import Tensor

from kfit.core import Energy, Prior
from kfit.core.pictures import Reduction, reduced
from kfit.energies.code_prior import CodePrior
from kfit.energies.depth import Depth
from kfit.energies.gradient import Gradient
from kfit.energies.local_ncc import LocalNCC
from kfit.energies.lpips import LPIPS
from kfit.energies.ms_ssim import MSSSIM
from kfit.energies.mutual_information import MutualInformation
from kfit.energies.ncc import NCC
from kfit.energies.perceptual import Perceptual
from kfit.energies.pixel import L1, L2
from kfit.energies.psnr import PSNR
from kfit.energies.pyramid import Pyramid
from kfit.energies.robust import Cauchy, Charbonnier, GemanMcClure, Huber, Welsch
from kfit.energies.silhouette import Dice, Silhouette, SoftIoU
from kfit.energies.smoothness import BendingEnergy, TotalVariation
from kfit.energies.ssim import SSIM


class Compared(Protocol):
    """Compares pictures, as `kfit.energies` describes under the class's name."""

    def __call__(
        self,
        prediction: Tensor,
        target: Tensor,
        weight: Tensor | None = None,
        *,
        reduction: Reduction = "none",
        **settings: Any,
    ) -> Tensor: ...


def _compared(name: str, kind: type[Energy]) -> Compared:
    def function(
        prediction: Tensor,
        target: Tensor,
        weight: Tensor | None = None,
        *,
        reduction: Reduction = "none",
        **settings: Any,
    ) -> Tensor:
        energy = kind(**settings)
        if isinstance(target, Tensor):
            energy = energy.to(target.device)
        found: Tensor = energy(prediction, target, weight, reduction=reduction)
        return found

    _document(name, function, kind)
    return function


def _of_values(name: str, kind: type[Prior]) -> Callable[..., Tensor]:
    def function(value: Tensor, *, reduction: Reduction = "none", **settings: Any) -> Tensor:
        return reduced(kind(on="value", **settings)(value), reduction)

    _document(name, function, kind)
    return function


def _document(name: str, function: Any, kind: type) -> None:
    """Give a function its name, and the signature and the text of its class."""
    own = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.VAR_KEYWORD]
    settings = [p for p in inspect.signature(kind).parameters.values() if p.name != "on"]
    own += [p.replace(kind=p.KEYWORD_ONLY) for p in settings]
    function.__signature__ = inspect.Signature(own, return_annotation="Tensor")
    function.__name__ = function.__qualname__ = name
    # Names of other energies are those of the classes, one module up.
    text = inspect.getdoc(kind) or ""
    function.__doc__ = re.sub(r"(?<!`)`([A-Z]\w+)`", r"`kfit.energies.\1`", text)


l1 = _compared("l1", L1)
l2 = _compared("l2", L2)
charbonnier = _compared("charbonnier", Charbonnier)
huber = _compared("huber", Huber)
cauchy = _compared("cauchy", Cauchy)
geman_mcclure = _compared("geman_mcclure", GemanMcClure)
welsch = _compared("welsch", Welsch)
gradient = _compared("gradient", Gradient)
psnr = _compared("psnr", PSNR)
ssim = _compared("ssim", SSIM)
ms_ssim = _compared("ms_ssim", MSSSIM)
ncc = _compared("ncc", NCC)
local_ncc = _compared("local_ncc", LocalNCC)
mutual_information = _compared("mutual_information", MutualInformation)
perceptual = _compared("perceptual", Perceptual)
lpips = _compared("lpips", LPIPS)
pyramid = _compared("pyramid", Pyramid)
silhouette = _compared("silhouette", Silhouette)
soft_iou = _compared("soft_iou", SoftIoU)
dice = _compared("dice", Dice)
depth = _compared("depth", Depth)

code_prior = _of_values("code_prior", CodePrior)
total_variation = _of_values("total_variation", TotalVariation)
bending_energy = _of_values("bending_energy", BendingEnergy)
