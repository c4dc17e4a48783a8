"""Structural similarity at several scales."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from kornia.filters import filter2d_separable, get_gaussian_kernel1d
from torch import Tensor

from kfit.core import Energy
from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, normalized_weights

# Wang et al. 2003, section 3.2: exponents of the scales measured on observers, the finest first
_EXPONENTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
# Roots of a mean similarity below this are useless; the other scales still have a slope
_LEAST = 1e-4
_C1, _C2 = 0.01**2, 0.03**2


class MSSSIM(Energy):
    """Multi-scale structural dissimilarity of two pictures, 1 − MS-SSIM.

    E = 1 − Π_j s_j^β_j, where s_j is the mean of contrast and structure, (2σ_xy + C2) / (σ_x² + σ_y² + C2), over
    pixels and channels of the pictures halved j times, and at the coarsest scale that of SSIM itself. The window is a
    Gaussian of σ = 1.5 that stays inside the picture, K1 = 0.01, K2 = 0.03, range 1. β are the paper's; with fewer than
    five scales the first ones are used, divided by their sum. A mean s_j below 1e-4 is replaced by 1e-4. Where the
    weight is 0 both pictures are filled with white.

    At odd sides the coarser scale leaves the last row or column out, as torchmetrics does. pytorch-msssim pads with
    zeros there, which changed the similarity of two noisy 201×223 pictures by 0.001; at even sides all agree.

    Shape: pictures (N, C, H, W) in [0, 1]; weight (N, 1, H, W); energy (N,) in [0, 1].
    Source: Wang, Simoncelli and Bovik, Multi-scale structural similarity for image quality assessment, 2003.

    Args:
        num_scales: 1 to 5; None takes as many as fit: 3 for 64×64, 5 from 176×176 on.
        window_size: width of the window in pixels, odd.

    Raises:
        ValueError: if the number of scales is outside 1 to 5, the window is even or not positive, the pictures are too
            small for the window at the coarsest scale, or their shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import MSSSIM
        >>> picture = torch.rand(1, 3, 64, 64)
        >>> MSSSIM()(picture, picture) < 1e-6, MSSSIM()(torch.rand(1, 3, 64, 64), picture) > 0.5
        (tensor([True]), tensor([True]))
    """

    unit_range = True

    def __init__(self, num_scales: int | None = None, window_size: int = 11) -> None:
        super().__init__()
        check_arguments(MSSSIM, locals(), num_scales=(1, len(_EXPONENTS)))
        if window_size % 2 == 0:
            raise ValueError(f"window_size must be odd and positive, got {window_size}")
        self.num_scales, self.window_size = num_scales, window_size

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        target = target.to(torch.promote_types(target.dtype, torch.float32))  # variances are small differences
        picture, pixels, scales = fill_background(target, weight), weight, []
        for number in range(self._count(target)):
            if number:
                picture = F.avg_pool2d(picture, 2)
                pixels = None if pixels is None else F.avg_pool2d(pixels.to(picture.dtype), 2)
            mean, variance = self._moments(picture)
            inner = None if pixels is None else self._inside(pixels)
            scales.append(
                {"picture": picture, "mean": mean, "variance": variance, "share": normalized_weights(inner, mean)}
            )
        return {"scales": scales} if weight is None else {"scales": scales, "weight": weight}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        scales = prepared["scales"]
        target = scales[0]["picture"]
        check_shape("prediction", prediction, tuple(target.shape))
        picture = fill_background(prediction, prepared.get("weight")).to(target.dtype)
        exponents = _EXPONENTS[: len(scales)]
        logarithm = picture.new_zeros(len(picture))
        for number, scale in enumerate(scales):
            picture = F.avg_pool2d(picture, 2) if number else picture
            mean, variance = self._moments(picture)
            covariance = self._blur(picture * scale["picture"]) - mean * scale["mean"]
            similarity = (2 * covariance + _C2) / (variance + scale["variance"] + _C2)
            if number == len(scales) - 1:
                luminance = (2 * mean * scale["mean"] + _C1) / (mean.square() + scale["mean"].square() + _C1)
                similarity = similarity * luminance
            # the mean of what is missing, since shares that sum to almost 1 would leave the truth above 0
            similar = 1 - ((1 - similarity) * scale["share"]).sum((1, 2, 3))
            logarithm = logarithm + exponents[number] / sum(exponents) * similar.clamp_min(_LEAST).log()
        return -torch.expm1(logarithm)

    def _count(self, target: Tensor) -> int:
        """Return the number of scales to compare."""
        side = min(target.shape[-2:])
        fitting = sum(side >> number >= self.window_size for number in range(len(_EXPONENTS)))
        count = self.num_scales or fitting
        if not 1 <= count <= fitting:
            needed = self.window_size << max(count - 1, 0)
            raise ValueError(
                f"target must be at least {needed} pixels high and wide for {max(count, 1)} scales of a window of "
                f"{self.window_size}, got {tuple(target.shape[-2:])}"
            )
        return count

    def _moments(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        mean = self._blur(picture)
        return mean, self._blur(picture.square()) - mean.square()

    def _blur(self, picture: Tensor) -> Tensor:
        kernel = get_gaussian_kernel1d(self.window_size, 1.5, device=picture.device, dtype=picture.dtype)
        blurred: Tensor = filter2d_separable(picture, kernel, kernel, padding="valid")
        return blurred

    def _inside(self, pixels: Tensor) -> Tensor:
        """Return the pixels whose window lies inside the picture."""
        edge = self.window_size // 2
        return pixels[..., edge : pixels.shape[-2] - edge, edge : pixels.shape[-1] - edge]
