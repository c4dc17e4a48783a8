"""Normalised cross-correlation."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import ResidualEnergy
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, normalized_weights, root_weights

# A variance of (1e-4)², far below one grey level of 256: what a flat picture is divided by.
_LEAST_VARIANCE = 1e-8


class NCC(ResidualEnergy):
    """Zero-normalised cross-correlation as an energy: it ignores brightness and contrast.

    E = (1 − ρ) / 2, where ρ = (cov(x, y) + c) / √((var x + c) · (var y + c)) over all pixels and channels, each channel
    about its own weighted mean, and c = 1e-8 keeps flat pictures finite. E is 0 for pictures that differ by a positive
    gain and by offsets, 1/2 for unrelated pictures, 1 for negatives.

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,), residuals (N, C·H·W + 1); volumes
    (N, C, D, H, W) too.
    Source: Lewis, Fast normalized cross-correlation, 1995; OpenCV's TM_CCOEFF_NORMED.

    Raises:
        ValueError: if the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import NCC
        >>> picture = torch.rand(1, 3, 8, 8)
        >>> NCC()(0.5 * picture + 0.1, picture).round(decimals=3), NCC()(-picture, picture).round(decimals=3)
        (tensor([0.]), tensor([1.]))
    """

    volumes = True

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        share = {"share": normalized_weights(weight, target), "root": root_weights(weight, target)}
        target = fill_background(target, weight)
        prepared = {"target": target, "unit": _unit(target, share), "share": share}
        return prepared if weight is None else prepared | {"weight": weight}

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        check_shape("prediction", prediction, tuple(prepared["target"].shape))
        prediction = fill_background(prediction, prepared.get("weight"))
        # Of two unit vectors |a − b|² = 2 − 2 a·b, so half their difference squares to (1 − ρ) / 2.
        apart: Tensor = _unit(prediction, prepared["share"]) - prepared["unit"]
        return apart / 2


def _unit(image: Tensor, parts: dict[str, Tensor]) -> Tensor:
    """A row's deviations from their mean as one vector (N, C·H·W + 1) of length 1; its last number is √c's share."""
    share = parts["share"]
    axes = tuple(range(2, image.dim()))
    total = share.expand_as(image[:, :1]).sum(axes, keepdim=True)
    mean = (image * share).sum(axes, keepdim=True) / torch.where(total > 0, total, 1)
    deviation = ((image - mean) * parts["root"]).flatten(1)
    last = deviation.new_full((len(deviation), 1), _LEAST_VARIANCE**0.5)
    length = (deviation.square().sum(1, keepdim=True) + _LEAST_VARIANCE).sqrt()
    return torch.cat([deviation, last], 1) / length
