"""AlexNet with torchvision's published weights, without torchvision."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from kfit.core.check import check_choice, check_list
from kfit.features.network import FeatureNetwork
from kfit.features.published import fill_published

# channels out, kernel, stride, padding of each convolution
_CONVOLUTIONS = ((64, 11, 4, 2), (192, 5, 1, 2), (384, 3, 1, 1), (256, 3, 1, 1), (256, 3, 1, 1))
# The position of a name is torchvision's number of the module.
_NAMES = (
    "conv1", "relu1", "pool1", "conv2", "relu2", "pool2", "conv3", "relu3", "conv4", "relu4", "conv5", "relu5", "pool5",
)  # fmt: skip


class AlexNet(FeatureNetwork):
    """AlexNet trained on ImageNet, up to the last requested layer.

    Layers are "conv1", "relu1", … "relu5", "pool1", "pool2" and "pool5"; layer "relu5" of a 64×64 picture is
    (N, 256, 3, 3).

    Shape: pictures (N, 3, H, W), H and W at least 31 for layers from "pool2" on and 63 for "pool5".
    Source: Krizhevsky, One weird trick for parallelizing convolutional neural networks, 2014; weights as torchvision
    publishes them (BSD-3-Clause).

    Args:
        layers: names of the layers to return.
        weights: path of a .pth or .safetensors file with torchvision's names; None takes torchvision's published
            file from torch.hub's cache, and downloads it (233 MB) the first time.

    Raises:
        ValueError: if a layer does not exist, the file is truncated or holds another network, or pictures are too
            small for the layers.
        FileNotFoundError: if there is no file at ``weights``.
        RuntimeError: if the published file cannot be downloaded.

    Example:
        >>> from kfit.features import AlexNet
        >>> AlexNet(["relu6"])
        Traceback (most recent call last):
        ValueError: layers must be one of conv1, relu1, ... pool5, got 'relu6'
        >>> AlexNet(["relu5"])  # downloads the weights the first time  # doctest: +SKIP
    """

    url = "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth"
    megabytes = 233

    def __init__(self, layers: Sequence[str] = ("relu3",), weights: str | None = None) -> None:
        super().__init__()
        check_list("layers", layers, None, check_choice, _NAMES)
        self.features = nn.Sequential()
        self.layers: dict[int, str] = {}
        channels = 3
        for index, name in enumerate(_NAMES[: max(_NAMES.index(name) for name in layers) + 1]):
            if name in layers:
                self.layers[index] = name
            if name.startswith("conv"):
                width, kernel, stride, padding = _CONVOLUTIONS[int(name[4]) - 1]
                made = nn.utils.skip_init(nn.Conv2d, channels, width, kernel, stride, padding, dtype=torch.float32)
                self.features.append(made)
                channels = width
            elif name.startswith("relu"):
                # in-place saves memory, but would overwrite a requested convolution
                self.features.append(nn.ReLU(inplace=_NAMES[index - 1] not in layers))
            else:
                self.features.append(nn.MaxPool2d(3, 2))
        num_pools = sum(name.startswith("pool") for name in _NAMES[: len(self.features)])
        self.least_side = (7, 15, 31, 63)[num_pools]
        fill_published(self, self.url, self.megabytes, weights)
        self.freeze()

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        x, found = self.normalized(image), {}
        for index, module in enumerate(self.features):
            x = module(x)
            if index in self.layers:
                found[self.layers[index]] = x
        return found
