"""From a picture to a distribution over the poses that it may show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.check import check_choice, check_count, check_list, check_range, check_rising
from kfit.geometry import PoseNetwork, Symmetry, bin_log_probabilities


class PoseHead(PoseNetwork):
    """Tells how likely a picture shows its object at each azimuth and elevation: log-probabilities of bins.

    Bins are even in azimuth and in elevation, which is even over rotations too: with roll 0 the angle between close
    poses is √(Δazimuth² + Δelevation²). A picture that fits several poses, such as a mug whose handle is hidden, gets
    several peaks or a ridge. The network learns by `divergence` from soft targets, as classifiers of viewpoint do
    (Su et al. 2015, "Render for CNN", section 4.3). Four stride-2 convolutions, each but the first followed by a
    residual one, and two linear layers: 1.2 M parameters, 35 M multiply-adds a picture.

    Args:
        symmetry: of the category, see `kfit.geometry.CATEGORIES`; with ``"y"`` azimuth is free, so there is one bin of
            it and elevation alone is learned.
        channels: of the convolutions, one at each size.
        hidden_dim: between the linear layers.
        bin_deg: width of a bin.
        elevation_deg: (low, high) of the valid poses.
        spread_deg: standard deviation of a target around the true pose.
        image_size: side of the pictures it takes.

    Raises:
        ValueError: for a symmetry of another name, and widths or a range that hold no bin.
    """

    def __init__(
        self,
        symmetry: Symmetry = "none",
        channels: Sequence[int] = (32, 64, 128, 128),
        hidden_dim: int = 256,
        bin_deg: float = 10.0,
        elevation_deg: tuple[float, float] = (-15.0, 75.0),
        spread_deg: float = 6.0,
        image_size: int = 64,
    ) -> None:
        super().__init__()
        check_choice("PoseHead: symmetry", symmetry, ("none", "y"))
        check_list("PoseHead: channels", channels, None, check_count, 4, 4096)
        check_count("PoseHead: hidden_dim", hidden_dim, 1, 4096)
        check_count("PoseHead: image_size", image_size, 2 ** len(channels), 1024)
        check_range("PoseHead: bin_deg", bin_deg, 1, 90)
        check_range("PoseHead: spread_deg", spread_deg, 0.1, 90)
        check_rising("PoseHead: elevation_deg", elevation_deg, -90, 90)
        low, high = elevation_deg
        self.symmetry, self.sigma = symmetry, math.radians(spread_deg)
        rings = max(1, round((high - low) / bin_deg))
        self.register_buffer("azimuths", _centres(-180, 180, 1 if symmetry == "y" else round(360 / bin_deg)), False)
        self.register_buffer("elevations", _centres(low, high, rings), False)
        self.look = nn.Sequential(_convolution(3, channels[0], 2))
        for a, b in pairwise(channels):
            self.look.extend([_convolution(a, b, 2), _Residual(b)])
        seen = channels[-1] * (image_size // 2 ** len(channels)) ** 2
        bins = len(self.azimuths) * rings
        self.say = nn.Sequential(nn.Linear(seen, hidden_dim), nn.LeakyReLU(0.2), nn.Linear(hidden_dim, bins))

    def forward(self, image: Tensor) -> Tensor:
        said = self.say(self.look(2 * image - 1).flatten(1))
        said = said.to(torch.promote_types(said.dtype, torch.float32))  # autocast's halves are too coarse for a log
        return F.log_softmax(said, 1).view(-1, len(self.azimuths), len(self.elevations))

    def divergence(self, log_probability: Tensor, azimuth: Tensor, elevation: Tensor) -> Tensor:
        """How far what was said lies from the truth: KL(target ‖ said) = Σ q (log q − log p) in nats, 0 at best.

        The target q is, over the bins, a von Mises distribution in azimuth times a Gaussian in elevation, of
        ``spread_deg`` around the true pose. Its entropy does not depend on the network, so the gradient is that of the
        cross-entropy.

        Args:
            log_probability: (N, A, E), what ``forward`` gave.
            azimuth, elevation: (N,) the true pose in radians.

        Returns:
            (N,).
        """
        log_azimuth, log_elevation = bin_log_probabilities(
            azimuth, elevation, self.azimuths, self.elevations, self.sigma
        )
        target = log_azimuth[:, :, None] + log_elevation[:, None]
        return F.kl_div(log_probability, target, reduction="none", log_target=True).sum((1, 2))


class _Residual(nn.Module):
    def __init__(self, dim: int) -> None:
        super().__init__()
        self.change = _convolution(dim, dim, 1)

    def forward(self, x: Tensor) -> Tensor:
        changed: Tensor = x + self.change(x)
        return changed


def _convolution(a: int, b: int, stride: int) -> nn.Sequential:
    # The normalisation has the offset.
    return nn.Sequential(nn.Conv2d(a, b, 3, stride, 1, bias=False), nn.BatchNorm2d(b), nn.LeakyReLU(0.2))


def _centres(low_deg: float, high_deg: float, count: int) -> Tensor:
    low, high = math.radians(low_deg), math.radians(high_deg)
    return low + (high - low) * (torch.arange(count) + 0.5) / count
