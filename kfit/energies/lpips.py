"""Learned perceptual similarity."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from kfit.core import ResidualEnergy
from kfit.core.arguments import check_arguments
from kfit.energies.weighting import fill_background, root_weights
from kfit.features import VGG16, AlexNet, FeatureNetwork


class LPIPS(ResidualEnergy):
    """Learned perceptual image patch similarity, version 0.1.

    E = Σ_l mean over pixels of Σ_c a_lc · (F_lc(x) / |F_l(x)| − F_lc(y) / |F_l(y)|)², where |F_l| is the length over
    channels at each pixel and a_lc ≥ 0 are the published linear heads. Pictures are normalised as in the original, by
    ImageNet's mean and deviation. The features of the target are computed once, in ``prepare``.

    Where the weight is 0 both pictures are filled with white. In each layer the weight is resized by area.

    Shape: pictures (N, 3, H, W) in [0, 1], H and W at least 31 ("alex") or 16 ("vgg"); weight (N, 1, H, W); energy
    (N,); residuals (N, Σ_l C_l·h_l·w_l).
    Source: Zhang et al., The unreasonable effectiveness of deep features as a perceptual metric, 2018; heads as
    torchmetrics ships them (BSD-2-Clause).

    Args:
        backbone: feature network: "alex", with which its authors report scores, or "vgg", which they use as a loss.
        weights: path of the backbone's weights as in `kfit.features.AlexNet` and `kfit.features.VGG16`. With None,
            torchvision's published file is downloaded once.

    Raises:
        ValueError: if the backbone is unknown, or the weights belong to another network.
        ImportError: if torchmetrics, which holds the heads, is missing.
        FileNotFoundError, RuntimeError: as raised by the backbone.

    Example:
        >>> from kfit.energies import LPIPS
        >>> lpips = LPIPS("vgg")  # doctest: +SKIP
        >>> lpips(prediction, target)  # (N,); downloads VGG16 the first time  # doctest: +SKIP
    """

    mixed = True
    unit_range = True

    def __init__(self, backbone: Literal["alex", "vgg"] = "alex", weights: str | None = None) -> None:
        super().__init__()
        self.network: FeatureNetwork
        check_arguments(LPIPS, locals())
        if backbone == "alex":
            self.network = AlexNet(tuple(f"relu{number}" for number in range(1, 6)), weights)
        else:
            self.network = VGG16(("relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3"), weights)
        for number, head in enumerate(_heads(backbone)):
            self.register_buffer(f"head{number}", head, persistent=False)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        features = self._features(fill_background(target, weight))
        scale = {}
        for number, (name, feature) in enumerate(features.items()):
            # a share is one of all numbers of a layer, and this is a sum over channels
            root = root_weights(weight, feature) * feature.shape[1] ** 0.5
            scale[name] = root * self.get_buffer(f"head{number}").sqrt()
        return super().prepare(features, weight) | {"scale": scale}

    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        features, target = self._features(fill_background(prediction, prepared.get("weight"))), prepared["target"]
        parts = [(feature - target[name]) * prepared["scale"][name] for name, feature in features.items()]
        return torch.cat([part.flatten(1) for part in parts], 1)

    def _features(self, image: Tensor) -> dict[str, Tensor]:
        """Features by layer, of length 1 over the channels of each pixel."""
        return {name: _unit(feature) for name, feature in self.network(image).items()}


def _unit(feature: Tensor) -> Tensor:
    feature = feature.to(torch.promote_types(feature.dtype, torch.float32))
    # the small number under the root keeps pixels without features differentiable
    return feature / (feature.square().sum(1, keepdim=True) + 1e-8).sqrt()


def _heads(backbone: str) -> list[Tensor]:
    """A layer's weights of channels (1, C, 1, 1), shallowest layer first."""
    # found without being imported: that takes seconds, and this needs a file of 6 kB
    found = find_spec("torchmetrics")
    if found is None or found.origin is None:
        raise ImportError("LPIPS needs the linear heads that torchmetrics ships: pip install torchmetrics")
    file = Path(found.origin).parent / "functional" / "image" / "lpips_models" / f"{backbone}.pth"
    state = torch.load(file, map_location="cpu", weights_only=True)
    return [state[f"lin{number}.model.1.weight"] for number in range(5)]
