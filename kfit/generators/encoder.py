"""A convolutional encoder: from a picture to a Gaussian over codes."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Encoder
from kfit.core.arguments import check_arguments
from kfit.core.check import check_count
from kfit.runtime.old_weights import read_old_weights

# Tints of objects differ by about 0.1; this scales them to the size of the other features.
TINT_GAIN = 10.0
# Codes start with a small variance (σ = 0.14), so that noise does not hide small differences between objects.
FIRST_LOG_VARIANCE = -4.0


class ConvEncoder(Encoder):
    """Predict the code of a picture by convolutions.

    Stride-2 convolutions, then two linear layers. The first one also takes the picture's tint (RGB minus its mean over
    the channels), averaged over a coarse grid: with normalised convolutions alone, training learnt brightness and shape
    but no hue. The released encoder is ``channels=(64, 128, 256, 512), tint_grid=0, instance_norm=True, bounded=True``.

    Args:
        code_dim: D.
        channels: number of channels of each convolution.
        hidden_dim: units between the linear layers.
        image_size: side of the input pictures.
        tint_grid: cells along each side over which the tint is averaged; 0 omits it.
        instance_norm: whether the features of all convolutions but the first are normalised, as in the released
            encoder.
        bounded: whether mean and log-variance pass a tanh, as in the released code.

    Example:
        >>> import torch
        >>> from kfit.generators import ConvEncoder
        >>> mean, log_variance = ConvEncoder(code_dim=8)(torch.rand(2, 3, 64, 64))
        >>> mean.shape, log_variance.shape
        (torch.Size([2, 8]), torch.Size([2, 8]))
    """

    def __init__(
        self,
        code_dim: int = 16,
        channels: Sequence[int] = (32, 64, 128, 256),
        hidden_dim: int = 128,
        image_size: int = 64,
        tint_grid: int = 4,
        instance_norm: bool = False,
        bounded: bool = False,
    ) -> None:
        super().__init__()
        check_arguments(ConvEncoder, locals(), tint_grid=(0,))
        check_count("ConvEncoder: image_size", image_size, 2 ** len(channels))
        check_count("ConvEncoder: tint_grid", tint_grid, 0, image_size)
        layers: list[nn.Module] = []
        for index, (a, b) in enumerate(zip((3, *channels[:-1]), channels, strict=True)):
            layers += [nn.Conv2d(a, b, 3, 2, 1), nn.LeakyReLU(0.2)]
            if index and instance_norm:
                layers.append(nn.InstanceNorm2d(b))
        self.features = nn.Sequential(*layers)
        self.tint_grid, self.bounded = tint_grid, bounded
        size = channels[-1] * (image_size // 2 ** len(channels)) ** 2 + 3 * tint_grid**2
        last = nn.Linear(hidden_dim, 2 * code_dim)
        nn.init.constant_(last.bias[code_dim:], FIRST_LOG_VARIANCE)
        self.output = nn.Sequential(nn.Linear(size, hidden_dim), nn.LeakyReLU(0.2), last)
        read_old_weights(self)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and log-variance (N, D) of the code, from RGB (N, 3, S, S) in [0, 1] on white."""
        features = self.features(2 * image - 1).flatten(1)
        if self.tint_grid:
            tint = F.adaptive_avg_pool2d(image - image.mean(1, keepdim=True), self.tint_grid)
            features = torch.cat([features, (TINT_GAIN * tint).flatten(1).to(features.dtype)], 1)
        output = self.output(features).tanh() if self.bounded else self.output(features)
        # Half precision, under autocast, is too coarse for the code's mean.
        mean, log_variance = output.to(torch.promote_types(output.dtype, torch.float32)).chunk(2, 1)
        return mean, log_variance
