"""A pose head for all rotations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Rendering
from kfit.core.arguments import check_arguments
from kfit.core.check import check_count
from kfit.features.convolutions import Residual, convolution
from kfit.generators.similarity_warp import warp
from kfit.geometry import Symmetry, check_symmetry, num_turns
from kfit.geometry.pose_network import PoseNetwork

# Standard deviation of the rolls of objects that stand, in photos taken by hand.
UPRIGHT_SPREAD_DEG = 15.0


class RotationHead(PoseNetwork):
    """Predict log-probabilities of bins of rotations from a picture.

    By the chain rule, log p(roll, azimuth, elevation | I) = log p(roll | I) + log p(azimuth, elevation | I, roll). One
    convolutional network has an output for each factor: roll from the original picture, azimuth and elevation from the
    picture rotated back by a roll. A forward pass rotates the picture back by each roll bin; the roll outputs of all
    rotated pictures are averaged (in logarithms, each shifted by its rotation), so that a rotation of the picture by a
    bin shifts the distribution of the evidence by a bin. It is multiplied by a prior, because objects mostly stand: a
    share ``upright`` of the rolls is normal around 0 with a standard deviation of 15°, the others are uniform.

    In views straight from above or below, where roll and azimuth are indistinguishable, the targets cover all pairs of
    the same rotation, because they depend on the rotation alone.

    A stride-2 convolution for each level, all but the first followed by a residual one, then two linear layers.

    Args:
        symmetry: symmetry of the category; with ``"y"`` azimuth is free and has one bin.
        channels: numbers of channels of the levels, each of half the width and height of the previous one.
        hidden_dim: units between the linear layers.
        bin_deg: width of a bin in degrees; it must divide 180.
        sigma_deg: standard deviation of a target around the true rotation.
        image_size: side of the pictures in pixels.
        upright: share of objects that stand, in [0, 1]; 0 for no preference.

    Raises:
        ValueError: if an argument is out of range.

    Example:
        >>> import torch
        >>> from kfit.generators import RotationHead
        >>> head = RotationHead(bin_deg=30, channels=(4, 4), hidden_dim=8).eval()
        >>> log_probability = head(torch.rand(2, 3, 64, 64))
        >>> log_probability.shape, log_probability.exp().sum(1).detach().round(decimals=2)
        (torch.Size([2, 864]), tensor([1., 1.]))
    """

    log_prior: Tensor

    def __init__(
        self,
        symmetry: Symmetry = "none",
        channels: Sequence[int] = (32, 64, 128, 256),
        hidden_dim: int = 256,
        bin_deg: float = 12.0,
        sigma_deg: float = 7.0,
        image_size: int = 64,
        upright: float = 0.5,
    ) -> None:
        check_arguments(
            RotationHead,
            locals(),
            symmetry=(check_symmetry,),
            channels=(4,),
            bin_deg=(5, 90),
            sigma_deg=(0.1, 90),
            upright=(0, 1),
        )
        check_count("RotationHead: image_size", image_size, 2 ** len(channels))
        if 180 % bin_deg:
            raise ValueError(f"RotationHead: bin_deg must divide 180, got {bin_deg:g}")
        turn = _bins(-180, 180, round(360 / bin_deg))
        super().__init__(
            rolls=2 * math.pi * torch.arange(len(turn)) / len(turn),
            azimuths=azimuth_bins(symmetry, bin_deg),
            elevations=_bins(-90, 90, round(180 / bin_deg)),
            symmetry=symmetry,
            sigma=math.radians(sigma_deg),
        )
        off = torch.arange(len(turn)) * 360 / len(turn)
        standing = torch.exp(-0.5 * (torch.minimum(off, 360 - off) / UPRIGHT_SPREAD_DEG).square())
        prior = upright * standing / standing.sum() + (1 - upright) / len(turn)
        self.register_buffer("log_prior", prior.clamp_min(1e-6).log(), persistent=False)
        self.features = nn.Sequential(convolution(3, channels[0], 2))
        for a, b in pairwise(channels):
            self.features.extend([convolution(a, b, 2), Residual(b)])
        self.hidden = nn.Linear(channels[-1] * (image_size // 2 ** len(channels)) ** 2, hidden_dim)
        self.roll = nn.Linear(hidden_dim, self.num_rolls)
        self.view = nn.Linear(hidden_dim, self.num_azimuths * self.num_elevations)

    def forward(self, image: Tensor) -> Tensor:
        rows, count = len(image), self.num_rolls
        back = -self._roll(torch.arange(count, device=image.device))
        rotated = _rotated(image.repeat_interleave(count, 0), back.repeat(rows))
        roll, view = (output.unflatten(0, (rows, count)) for output in self._outputs(rotated))
        # In the picture rotated back by bin k, the object is at roll j − k.
        bins = torch.arange(count, device=image.device)
        roll = roll.gather(2, ((bins - bins[:, None]) % count).expand(rows, -1, -1)).mean(1)
        roll = (roll + self.log_prior).log_softmax(1)
        joint: Tensor = (roll[:, :, None] + view).flatten(1)
        return joint

    def divergence(self, image: Tensor, azimuth: Tensor, elevation: Tensor, roll: Tensor) -> Tensor:
        """Return KL(q ‖ p) (N,) in nats between targets q (``log_kernel``) and predictions p, estimated by sampling.

        By the chain rule it is KL(q(roll) ‖ p(roll)) + E_q(roll) KL(q(view | roll) ‖ p(view | roll)). The expectation
        is over one roll drawn from q for each picture. The roll output learns from the original picture and from the
        rotated one, half each.

        Args:
            image: (N, 3, S, S) in [0, 1] on white.
            azimuth, elevation, roll: (N,) the true angles in radians.
        """
        with torch.no_grad():
            joint = self.log_kernel(azimuth, elevation, roll).unflatten(1, (self.num_rolls, -1))
            target_roll = joint.logsumexp(2)
            drawn = torch.multinomial(target_roll.exp(), 1)
            target_view = joint.take_along_dim(drawn[..., None], 1)[:, 0].log_softmax(1)
            bins = torch.arange(self.num_rolls, device=image.device)
            shifted_roll = target_roll.gather(1, (bins + drawn) % self.num_rolls)
            pictures = torch.cat([image, _rotated(image, -self._roll(drawn[:, 0]))])
        predicted_roll, predicted_view = self._outputs(pictures)
        rolls = _divergence(predicted_roll, torch.cat([target_roll, shifted_roll])).view(2, -1).mean(0)
        return rolls + _divergence(predicted_view[len(image) :], target_view)

    def _roll(self, number: Tensor) -> Tensor:
        return 2 * math.pi / self.num_rolls * number

    def _outputs(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return log-probabilities of rolls (N, R) and of views (N, A · E)."""
        hidden = F.leaky_relu(self.hidden(self.features(2 * image - 1).flatten(1)), 0.2)
        outputs = self.roll(hidden), self.view(hidden)
        # Half precision, under autocast, is too coarse for a logarithm.
        roll, view = (out.to(torch.promote_types(out.dtype, torch.float32)).log_softmax(1) for out in outputs)
        return roll, view


def _bins(low_deg: float, high_deg: float, count: int) -> Tensor:
    low, high = math.radians(low_deg), math.radians(high_deg)
    return low + (high - low) * (torch.arange(count) + 0.5) / count


def azimuth_bins(symmetry: Symmetry, bin_deg: float) -> Tensor:
    """Centres of azimuth bins in radians: over the azimuths that are different poses, one where all are alike."""
    turns = num_turns(symmetry)
    if not turns:
        return torch.zeros(1)
    return _bins(-180 / turns, 180 / turns, max(1, round(360 / turns / bin_deg)))


def _rotated(image: Tensor, roll: Tensor) -> Tensor:
    zero, one = roll.new_zeros(len(roll), 2), torch.ones_like(roll)
    return warp(Rendering(image), roll.to(image), zero.to(image), one.to(image)).image


def _divergence(log_probability: Tensor, log_target: Tensor) -> Tensor:
    return F.kl_div(log_probability, log_target, reduction="none", log_target=True).sum(1)
