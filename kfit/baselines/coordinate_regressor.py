"""A regressor of object coordinates for each pixel, as in NOCS."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.geometry import Symmetry, check_symmetry, num_turns, turns_about_y
from kfit.runtime.old_weights import read_old_weights

# How many turns a free turn about y is cut into; NOCS's loss tries as many.
NUM_TURNS = 6


class CoordinateRegressor(nn.Module):
    """Predict the object coordinates of each pixel in a picture of a cropped object.

    Source: Wang et al. 2019, "Normalized Object Coordinate Space", section 5.

    Coordinates are the object's own, y up, in units of its box diagonal with the box's centre at 0: those of
    `kfit.data.View` for a normalised mesh, in [−1/2, 1/2], and NOCS's published ones less 1/2. Each of the three is
    classified into ``num_bins`` even bins, which NOCS found better than regression. A U-Net: four times down by
    stride-2 convolutions and up again, with skip connections. 1.7 M parameters, 0.33 G multiply-adds a
    picture of 64 × 64.

    Args:
        symmetry: symmetry of the category, see `kfit.geometry.CATEGORIES`; with ``"y"`` the loss is the least over
            rotations about y.
        channels: numbers of channels of the convolutions, one at each size.
        num_bins: B.

    Raises:
        ValueError: if the symmetry is unknown, or there are fewer than two bins.
    """

    centres: Tensor
    turns: Tensor

    def __init__(
        self, symmetry: Symmetry = "none", channels: Sequence[int] = (24, 48, 96, 160, 160), num_bins: int = 32
    ) -> None:
        super().__init__()
        check_arguments(CoordinateRegressor, locals(), symmetry=(check_symmetry,), num_bins=(2,))
        self.num_bins = num_bins
        self.register_buffer("centres", (torch.arange(num_bins) + 0.5) / num_bins - 0.5, persistent=False)
        turns = turns_about_y(num_turns(symmetry) or NUM_TURNS).float()
        self.register_buffer("turns", turns, persistent=False)
        self.down = nn.ModuleList([_convolution(3, channels[0], 1)])
        self.up = nn.ModuleList()
        for a, b in pairwise(channels):
            self.down.append(nn.Sequential(_convolution(a, b, 2), _convolution(b, b, 1)))
            self.up.insert(0, _convolution(a + b, a, 1))
        self.output = nn.Conv2d(channels[0], 3 * num_bins, 1)
        read_old_weights(self)

    def forward(self, image: Tensor) -> Tensor:
        """Return logits (N, 3, B, S, S) of the bins of x, y and z, from pictures (N, 3, S, S) in [0, 1] on white.

        Raises:
            ValueError: if the pictures' side is not a multiple of 2^(number of sizes − 1).
        """
        check_shape("image", image, ("N", 3, "S", "S"))
        if image.shape[-1] % 2 ** len(self.up) or image.shape[-2] % 2 ** len(self.up):
            raise ValueError(f"image: sides must be multiples of {2 ** len(self.up)}, got {tuple(image.shape[-2:])}")
        x, sizes = 2 * image - 1, []
        for layer in self.down:
            x = layer(x)
            sizes.append(x)
        for layer, finer in zip(self.up, reversed(sizes[:-1]), strict=True):
            x = layer(torch.cat([F.interpolate(x, scale_factor=2.0), finer], 1))
        output = self.output(x)
        logits: Tensor = output.to(torch.promote_types(output.dtype, torch.float32)).unflatten(1, (3, self.num_bins))
        return logits

    @torch.no_grad()
    def coordinates(self, image: Tensor) -> Tensor:
        """Return coordinates (N, 3, S, S) in box diagonals; they are meaningless outside of the object.

        They are the mean over the likeliest bin and its neighbours, weighted by probability, which avoids quantisation.
        """
        probability = self(image).softmax(2)
        bins = torch.arange(self.num_bins, device=probability.device)[:, None, None]
        near = probability * ((bins - probability.argmax(2, keepdim=True)).abs() <= 1)
        found: Tensor = torch.einsum("ncbhw,b->nchw", near, self.centres) / near.sum(2)
        return found

    def divergence(self, logits: Tensor, coordinates: Tensor, mask: Tensor) -> Tensor:
        """Return the mean cross-entropy of the true coordinates over pixels and axes, in nats.

        With symmetry it is the least over the true coordinates rotated about y by k · 60°, k = 0 … 5 (NOCS, section
        5). One rotation is chosen for all pixels of an object.

        Args:
            logits: (N, 3, B, S, S) of ``forward``.
            coordinates: (N, 3, S, S), the truth in box diagonals.
            mask: (N, 1, S, S), above 1/2 where it is known.

        Returns:
            (N,), 0 where nothing is known.
        """
        known = (mask[:, 0] > 0.5).to(logits.dtype)
        amount = (3 * known.sum((1, 2))).clamp_min(1)
        log_share = logits.log_softmax(2)
        losses = []
        for turn in self.turns:
            rotated = torch.einsum("ij,njhw->nihw", turn, coordinates)
            bins = ((rotated + 0.5) * self.num_bins).long().clamp(0, self.num_bins - 1)
            each = -log_share.gather(2, bins.unsqueeze(2)).squeeze(2).sum(1)
            losses.append((each * known).sum((1, 2)) / amount)
        return torch.stack(losses).amin(0)


def _convolution(a: int, b: int, stride: int) -> nn.Sequential:
    # The normalisation has the offset.
    return nn.Sequential(nn.Conv2d(a, b, 3, stride, 1, bias=False), nn.BatchNorm2d(b), nn.LeakyReLU(0.2))
