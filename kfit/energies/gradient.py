"""An energy of picture gradients."""

from __future__ import annotations

from typing import Any

from kornia.filters import spatial_gradient
from torch import Tensor

from kfit.core import ResidualEnergy
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, root_weights


class Gradient(ResidualEnergy):
    """Mean squared difference of two pictures' gradients, which ignores constant changes of brightness.

    E = mean over channels and pixels of (∂_h x − ∂_h y)² + (∂_v x − ∂_v y)², with Kornia's normalised Sobel filter and
    replicated borders, in picture units per pixel. Where the weight is 0 both pictures are filled with white, so that
    hidden pixels do not change their neighbours' gradients.

    Shape: pictures (N, C, H, W), weight (N, 1, H, W), energy (N,), residuals (N, 2·C·H·W).

    Raises:
        ValueError: if the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import Gradient
        >>> picture = torch.rand(1, 3, 8, 8)
        >>> Gradient()(picture + 0.2, picture) < 1e-9  # brighter by a constant
        tensor([True])
    """

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        return super().prepare(fill_background(target, weight), weight)

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        target, weight = prepared["target"], prepared.get("weight")
        check_shape("prediction", prediction, tuple(target.shape))
        # The filter is linear: the slopes of the difference are the differences of the slopes.
        slopes = spatial_gradient(fill_background(prediction, weight) - target)
        residuals: Tensor = slopes * root_weights(weight, target).unsqueeze(2)
        return residuals.flatten(1)
