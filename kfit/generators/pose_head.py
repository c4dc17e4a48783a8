"""A pose head for upright objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.arguments import check_arguments
from kfit.core.check import check_count, check_rising
from kfit.features.convolutions import Residual, convolution
from kfit.generators.rotation_head import _bins, azimuth_bins
from kfit.geometry import Symmetry, check_symmetry
from kfit.geometry.pose_network import PoseNetwork
from kfit.runtime.old_weights import read_old_weights


class PoseHead(PoseNetwork):
    """Predict log-probabilities of bins of azimuth and elevation, of an upright object, from a picture.

    It is the head of kfit 0.1's models and does not predict roll; `RotationHead` covers all rotations. Four stride-2
    convolutions, all but the first followed by a residual one, and two linear layers: 1.2 M parameters, 35 M
    multiply-adds a picture.

    Args:
        symmetry: symmetry of the category, see `kfit.geometry.CATEGORIES`; with ``"y"`` azimuth is free and has one
            bin.
        channels: numbers of channels of the convolutions, one at each size.
        hidden_dim: units between the linear layers.
        bin_deg: width of a bin in degrees.
        elevation_deg: (low, high) of the valid poses in degrees.
        sigma_deg: standard deviation of a target around the true pose in degrees.
        image_size: side of the input pictures in pixels.

    Raises:
        ValueError: if the symmetry is unknown, or a width or range holds no bin.

    Example:
        >>> import torch
        >>> from kfit.generators import PoseHead
        >>> PoseHead()(torch.rand(2, 3, 64, 64)).shape  # 36 azimuths × 9 elevations
        torch.Size([2, 324])
    """

    def __init__(
        self,
        symmetry: Symmetry = "none",
        channels: Sequence[int] = (32, 64, 128, 128),
        hidden_dim: int = 256,
        bin_deg: float = 10.0,
        elevation_deg: tuple[float, float] = (-15.0, 75.0),
        sigma_deg: float = 6.0,
        image_size: int = 64,
    ) -> None:
        check_arguments(
            PoseHead,
            locals(),
            symmetry=(check_symmetry,),
            channels=(4,),
            bin_deg=(1, 90),
            sigma_deg=(0.1, 90),
            elevation_deg=(check_rising, -90, 90),
        )
        check_count("PoseHead: image_size", image_size, 2 ** len(channels))
        low, high = elevation_deg
        super().__init__(
            rolls=torch.zeros(1),
            azimuths=azimuth_bins(symmetry, bin_deg),
            elevations=_bins(low, high, max(1, round((high - low) / bin_deg))),
            symmetry=symmetry,
            sigma=math.radians(sigma_deg),
        )
        self.features = nn.Sequential(convolution(3, channels[0], 2))
        for a, b in pairwise(channels):
            self.features.extend([convolution(a, b, 2), Residual(b)])
        size = channels[-1] * (image_size // 2 ** len(channels)) ** 2
        bins = self.num_azimuths * self.num_elevations
        self.output = nn.Sequential(nn.Linear(size, hidden_dim), nn.LeakyReLU(0.2), nn.Linear(hidden_dim, bins))
        read_old_weights(self)

    def forward(self, image: Tensor) -> Tensor:
        output = self.output(self.features(2 * image - 1).flatten(1))
        # Autocast's halves are too coarse for a logarithm.
        output = output.to(torch.promote_types(output.dtype, torch.float32))
        return F.log_softmax(output, 1)
