"""EfficientNet-Lite0 as ImageNet's classifier: its last features and the logits of 1000 classes."""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor, nn

from kfit.features.efficientnet_lite import EfficientNetLite0, convolution, weights

LAST_BLOCK = 15
NUM_FEATURES, NUM_CLASSES = 1280, 1000


class ImageNetClassifier(nn.Module):
    """EfficientNet-Lite0 with its pooled features and classes.

    Features f are the means over the picture of the last convolution's 1280 channels, and the logits of ImageNet's 1000
    classes are V·f + c. The network is trained on pictures of 224 × 224 pixels.

    Shape: pictures (N, 3, H, W), RGB in [0, 1]; features (N, 1280) and logits (N, 1000).
    Source: as `kfit.features.EfficientNetLite0`.

    Raises:
        ImportError: if the package with the weights is missing.
    """

    class_weight: Tensor
    class_bias: Tensor

    def __init__(self) -> None:
        super().__init__()
        state = weights()
        self.blocks = EfficientNetLite0((LAST_BLOCK,))
        self.last = convolution(state, "_conv_head", "_bn1")
        self.register_buffer("class_weight", state["_fc.weight"])
        self.register_buffer("class_bias", state["_fc.bias"])
        self.requires_grad_(False).eval()

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        found = F.relu6(self.last(self.blocks(image)[f"block{LAST_BLOCK}"]))
        features = found.mean((2, 3))
        return features, features @ self.class_weight.T + self.class_bias
