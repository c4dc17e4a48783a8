"""VGG16 and VGG19 with torchvision's published weights, without torchvision."""

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
                # in-place saves memory, but would overwrite a requested convolution
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
    """VGG16 trained on ImageNet, up to the last requested layer.

    Layers are "conv1_1", "relu1_1", … "relu5_3", "pool1" … "pool5"; layer "relu3_3" of a (N, 3, H, W) picture is
    (N, 256, H // 4, W // 4).

    Source: Simonyan and Zisserman, 2015; weights as torchvision publishes them (BSD-3-Clause).

    Args:
        layers: names of the layers to return.
        weights: path of a .pth or .safetensors file with torchvision's names; None takes torchvision's published
            file from torch.hub's cache, and downloads it (528 MB) the first time.

    Raises:
        ValueError: if a layer does not exist, or the file is truncated or holds another network.
        FileNotFoundError: if there is no file at ``weights``.
        RuntimeError: if the published file cannot be downloaded.

    Example:
        >>> from kfit.features import VGG16
        >>> VGG16(weights="missing.pth")
        Traceback (most recent call last):
        FileNotFoundError: weights: there is no file missing.pth
        >>> VGG16(["relu2_2", "relu3_3"])  # downloads the weights the first time  # doctest: +SKIP
    """

    convolutions = (2, 2, 3, 3, 3)
    url = "https://download.pytorch.org/models/vgg16-397923af.pth"
    megabytes = 528


class VGG19(_VGG):
    """VGG19 trained on ImageNet, up to the last requested layer.

    As `VGG16`, with layers up to "relu5_4"; its published file has 548 MB. The released code of the paper compares
    layer "conv3_3".

    Example:
        >>> from kfit.features import VGG19
        >>> VGG19(weights="missing.pth")
        Traceback (most recent call last):
        FileNotFoundError: weights: there is no file missing.pth
        >>> VGG19(["conv3_3"])  # downloads the weights the first time  # doctest: +SKIP
    """

    convolutions = (2, 2, 4, 4, 4)
    url = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"
    megabytes = 548


def _convolution(channels: int, width: int) -> nn.Module:
    """Return an uninitialised 3 × 3 convolution in single precision, whatever torch's default type is."""
    made: nn.Module = nn.utils.skip_init(nn.Conv2d, channels, width, 3, padding=1, dtype=torch.float32)
    return made


def _names(convolutions: tuple[int, ...]) -> list[str]:
    """Return layer names in order: the position of a name is torchvision's number of the module."""
    names = []
    for block, count in enumerate(convolutions, 1):
        names += [f"{kind}{block}_{i}" for i in range(1, count + 1) for kind in ("conv", "relu")]
        names.append(f"pool{block}")
    return names
