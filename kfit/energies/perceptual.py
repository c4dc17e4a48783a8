"""A distance of network features: the paper's energy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from kfit.core import ResidualEnergy, frozen
from kfit.core.arguments import check_arguments
from kfit.core.check import check_names
from kfit.energies.weighting import fill_background, normalized_weights, root_weights
from kfit.features import FeatureNetwork


class Perceptual(ResidualEnergy):
    """Mean squared difference of two pictures' features, averaged over a network's L layers.

    E = 1/L Σ_l d_l², with d_l² = mean over channels and pixels of (F_l(x) − F_l(y))², divided by the mean square of
    F_l(y) if ``normalize``; E = 1/L Σ_l d_l if not ``squared``. The features of the target are computed once, in
    ``prepare``. A frozen copy of the network in evaluation mode is used; the network that was passed is not changed.

    Where the weight is 0 both pictures are filled with white, so that hidden pixels stay out of the receptive fields
    of others. In each layer the weight is resized by area.

    Shape: pictures (N, 3, H, W) in [0, 1]; weight (N, 1, H, W); energy (N,); residuals (N, Σ_l C_l·h_l·w_l).
    Source: paper eq. for E(I, R, T, z), ‖F(I) − F(Î)‖₂; the released code takes the mean square at VGG19's
    ``features[0..14]``, which is `kfit.features.VGG19` with layer "conv3_3".

    Args:
        network: maps pictures to features by layer; a module that returns one tensor has one layer.
        squared: True for the released code's mean square, False for the paper's norm (here a root mean square).
        normalize: whether each layer is divided by the mean square of the target's features, so that layers count
            alike. None normalizes if there is more than one layer.

    Example:
        >>> import torch
        >>> from kfit.energies import Perceptual
        >>> from kfit.features import EfficientNetLite0
        >>> energy = Perceptual(EfficientNetLite0())
        >>> picture = torch.rand(2, 3, 64, 64)
        >>> energy(picture, picture)
        tensor([0., 0.])
    """

    unit_range = True

    def __init__(
        self, network: FeatureNetwork | nn.Module, squared: bool = True, normalize: bool | None = None
    ) -> None:
        super().__init__()
        check_arguments(Perceptual, locals())
        self.network = frozen(network)
        self.mixed = getattr(network, "mixed", True)
        self.squared, self.normalize = squared, normalize

    def train(self, mode: bool = True) -> Perceptual:
        """Set the mode of the energy; its network stays in evaluation mode."""
        super().train(mode)
        self.network.eval()
        return self

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        features = self._features(fill_background(target, weight))
        normalize = len(features) > 1 if self.normalize is None else self.normalize
        scale = {}
        for name, feature in features.items():
            scale[name] = root_weights(weight, feature)
            if normalize:
                mean_square = (feature.square() * normalized_weights(weight, feature)).sum((1, 2, 3), keepdim=True)
                scale[name] = scale[name] / mean_square.clamp_min(1e-8).sqrt()
        return super().prepare(features, weight) | {"scale": scale}

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        features = self._features(fill_background(prediction, prepared.get("weight")))
        check_names("network", features, prepared["target"], complete=True)
        parts = []
        for name, target in prepared["target"].items():
            part = ((features[name] - target) * prepared["scale"][name]).flatten(1)
            if not self.squared:
                # E = d as a sum of squares too: r = part / √d; the small number keeps the truth differentiable
                part = part / (part.square().sum(1, keepdim=True) + 1e-12) ** 0.25
            parts.append(part)
        return torch.cat(parts, 1) / math.sqrt(len(parts))

    def _features(self, image: Tensor) -> Mapping[str, Tensor]:
        kept = next(self.network.parameters(), image)
        features: Mapping[str, Tensor] | Tensor = self.network(image.to(kept.dtype))
        named = features if isinstance(features, Mapping) else {"output": features}
        return {name: feature.to(torch.promote_types(feature.dtype, torch.float32)) for name, feature in named.items()}
