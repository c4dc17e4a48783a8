"""VGG16 and VGG19 without torchvision, on torchvision's published weights."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from kfit.core.check import check_choice, check_list
from kfit.features.network import FeatureNetwork
from kfit.features.published import fill_published


class _VGG(FeatureNetwork):
    convolutions: tuple[int, ...]
    url: str
    megabytes: int

    def __init__(self, layers: Sequence[str] = ("relu3_3",), weights: str | None = None) -> None:
        super().__init__()
        self.features = nn.Sequential()
        self.layers: dict[int, str] = {}
        known = _names(self.convolutions)
        check_list("layers", layers, None, check_choice, known)
        last = max(known.index(name) for name in layers)
        channels = 3
        for index, name in enumerate(known[: last + 1]):
            if name in layers:
                self.layers[index] = name
            if name.startswith("conv"):
                width = min(64 * 2 ** (int(name[4]) - 1), 512)
                self.features.append(_convolution(channels, width))
                channels = width
            elif name.startswith("relu"):
                # in place spares memory, and would overwrite a convolution that was asked for
                self.features.append(nn.ReLU(inplace=known[index - 1] not in layers))
            else:
                self.features.append(nn.MaxPool2d(2))
        self.least_side = 2 ** sum(name.startswith("pool") for name in known[: last + 1])
        fill_published(self, self.url, self.megabytes, weights)
        self.freeze()

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        x, found = self.normalized(image), {}
        for index, module in enumerate(self.features):
            x = module(x)
            if index in self.layers:
                found[self.layers[index]] = x
        return found


class VGG16(_VGG):
    """VGG16 trained on ImageNet, up to the last layer that is asked for.

    Layers are "conv1_1", "relu1_1", … "relu5_3", "pool1" … "pool5"; layer "relu3_3" of a (N, 3, H, W) picture is
    (N, 256, H // 4, W // 4).

    Source: Simonyan and Zisserman, 2015; weights as torchvision publishes them (BSD-3-Clause).

    Args:
        layers: names of the layers to give out.
        weights: path of a .pth or .safetensors file with torchvision's names; None takes torchvision's published
            file from torch.hub's cache, fetching it (528 MB) the first time.

    Raises:
        ValueError: for a layer that does not exist, or a file that is truncated or holds another network.
        FileNotFoundError: if there is no file at ``weights``.
        RuntimeError: if the published file can not be fetched.
    """

    convolutions = (2, 2, 3, 3, 3)
    url = "https://download.pytorch.org/models/vgg16-397923af.pth"
    megabytes = 528


class VGG19(_VGG):
    """VGG19 trained on ImageNet, up to the last layer that is asked for.

    As `VGG16`, with layers up to "relu5_4"; its published file has 548 MB. The released code of the paper compares
    layer "conv3_3".
    """

    convolutions = (2, 2, 4, 4, 4)
    url = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"
    megabytes = 548


def _convolution(channels: int, width: int) -> nn.Module:
    """A 3 × 3 convolution in single precision, whatever torch's default type is, yet to be filled."""
    made: nn.Module = nn.utils.skip_init(nn.Conv2d, channels, width, 3, padding=1, dtype=torch.float32)
    return made


def _names(convolutions: tuple[int, ...]) -> list[str]:
    """Layer names in order: the position of a name is torchvision's number of the module."""
    names = []
    for block, count in enumerate(convolutions, 1):
        names += [f"{kind}{block}_{i}" for i in range(1, count + 1) for kind in ("conv", "relu")]
        names.append(f"pool{block}")
    return names
