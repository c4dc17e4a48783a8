"""Structural similarity."""

from __future__ import annotations

from typing import Any

from kornia.metrics import ssim, ssim3d
from torch import Tensor

from kfit.core import Energy
from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.core.pictures import check_pictures
from kfit.energies.weighting import fill_background, normalized_weights


class SSIM(Energy):
    """Structural dissimilarity of two pictures, (1 − SSIM) / 2.

    E = mean over pixels and channels of (1 − SSIM) / 2, with Kornia's map: a Gaussian window of σ = 1.5, K1 = 0.01,
    K2 = 0.03, range 1, mirrored borders. E is 0 for equal pictures and 1 for opposite ones. Where the weight is 0 both
    pictures are filled with white, so that hidden pixels do not change their neighbours' windows.

    Shape: pictures (N, C, H, W) in [0, 1], H and W larger than half the window; weight (N, 1, H, W); energy (N,);
    volumes (N, C, D, H, W) too.
    Source: Wang et al., Image quality assessment: from error visibility to structural similarity, 2004.

    Args:
        window_size: width of the window in pixels, odd.

    Raises:
        ValueError: if the window is even or not positive, the pictures are too small for it, or their shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import SSIM
        >>> picture = torch.rand(2, 3, 32, 32)
        >>> noisy = (picture + 0.2 * torch.rand(2, 3, 32, 32)).clamp(0, 1)
        >>> SSIM()(picture, picture), bool((SSIM()(noisy, picture) > 0).all())
        (tensor([0., 0.]), True)
    """

    volumes = True
    unit_range = True

    def __init__(self, window_size: int = 11) -> None:
        super().__init__()
        check_arguments(SSIM, locals())
        if window_size % 2 == 0:
            raise ValueError(f"window_size must be odd and positive, got {window_size}")
        self.window_size = window_size

    def check(self, target: Any, weight: Tensor | None = None) -> None:
        super().check(target, weight)
        check_pictures("target", target, volumes=True, least_side=self.window_size // 2 + 1)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        measure = ssim if target.dim() == 4 else ssim3d
        # Kornia's eps would leave equal dark pictures at an energy above 0, and nothing here divides by 0
        similarity: Tensor = measure(fill_background(prediction, weight), target, self.window_size, eps=0.0)
        return ((1 - similarity) / 2 * normalized_weights(weight, target)).flatten(1).sum(1)
