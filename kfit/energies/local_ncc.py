"""Normalised cross-correlation in a window around each pixel."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

from kfit.core import Energy
from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, normalized_weights

# The square of about one grey level of 256: flatter windows hold noise alone.
_LEAST_VARIANCE = 1e-5


class LocalNCC(Energy):
    """Local normalised cross-correlation as an energy, which ignores gradual changes of brightness and contrast.

    E = mean over pixels and channels of (1 − ρ) / 2, where ρ = (cov(x, y) + c) / √((var x + c) · (var y + c)) over the
    weighted pixels of a square window, which the picture's border cuts off. c = 1e-5 makes flat windows agree. E is 0
    for pictures that differ by smooth changes of light, about 1/2 for unrelated pictures, 1 for negatives.

    Shape: pictures (N, C, H, W) in [0, 1], weight (N, 1, H, W), energy (N,); volumes (N, C, D, H, W) too.
    Source: Avants et al., Symmetric diffeomorphic image registration with cross-correlation, 2008 (there squared).

    Args:
        window_size: width of the window in pixels, odd.

    Raises:
        ValueError: if the window is even or a single pixel, or the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import L1, LocalNCC
        >>> picture = torch.rand(1, 1, 32, 32)
        >>> shaded = picture * torch.linspace(0.5, 1.0, 32)  # light falls off to the left
        >>> LocalNCC()(shaded, picture) < 0.01, L1()(shaded, picture) > 0.1
        (tensor([True]), tensor([True]))
    """

    volumes = True
    unit_range = True

    def __init__(self, window_size: int = 9) -> None:
        super().__init__()
        check_arguments(LocalNCC, locals(), window_size=(3,))
        if window_size % 2 == 0:
            raise ValueError(f"window_size must be odd and at least 3, got {window_size}")
        self.window_size = window_size

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        target = target.to(torch.promote_types(target.dtype, torch.float32))  # variances are small differences
        target = fill_background(target, weight)
        counted = torch.ones_like(target[:, :1]) if weight is None else weight.to(target.dtype)
        total = self._summed(counted)
        window = {"counted": counted, "total": torch.where(total > 0, total, 1)}
        mean, variance = self._moments(target, window)
        found = {
            "target": target,
            "mean": mean,
            "variance": variance,
            "share": normalized_weights(weight, target),
        } | window
        return found if weight is None else found | {"weight": weight}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target: Tensor = prepared["target"]
        check_shape("prediction", prediction, tuple(target.shape))
        prediction = fill_background(prediction.to(target.dtype), prepared.get("weight"))
        mean, variance = self._moments(prediction, prepared)
        covariance = self._mean(prediction * target, prepared) - mean * prepared["mean"]
        lengths = (variance + _LEAST_VARIANCE) * (prepared["variance"] + _LEAST_VARIANCE)
        correlation = (covariance + _LEAST_VARIANCE) / lengths.sqrt()
        energy: Tensor = ((1 - correlation) / 2 * prepared["share"]).flatten(1).sum(1)
        return energy

    def _moments(self, image: Tensor, window: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        mean = self._mean(image, window)
        return mean, self._mean(image.square(), window) - mean.square()

    def _mean(self, image: Tensor, window: dict[str, Tensor]) -> Tensor:
        return self._summed(image * window["counted"]) / window["total"]

    def _summed(self, image: Tensor) -> Tensor:
        """Sum over the window around each pixel, with zeros outside of the picture."""
        edge, axes = self.window_size // 2, image.dim() - 2
        pool = F.avg_pool2d if axes == 2 else F.avg_pool3d
        summed: Tensor = pool(F.pad(image, (edge, edge) * axes), self.window_size, 1, divisor_override=1)
        return summed
