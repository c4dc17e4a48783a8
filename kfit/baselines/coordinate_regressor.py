"""A regressor of object coordinates, pixel by pixel, in the manner of NOCS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.check import check_choice, check_count, check_list, check_shape
from kfit.geometry import Symmetry

# How many turns a free turn about y is cut into; NOCS's loss tries as many.
NUM_TURNS = 6


class CoordinateRegressor(nn.Module):
    """Tells for each pixel of an object which of its points is seen (Wang et al. 2019, "Normalized Object Coordinate
    Space", section 5), for a picture of an object that is cut out already.

    Coordinates are the object's own, y up, in units of its box diagonal with the box's centre at 0: those of
    `kfit.data.View` for a normalised mesh, in [−1/2, 1/2], and NOCS's published ones less 1/2. Each of the three is
    classified into ``num_bins`` even bins, which NOCS found better than regression. A U-Net: four times down by
    stride-2 convolutions and up again beside what was seen at each size. 1.7 M parameters, 0.33 G multiply-adds a
    picture of 64 × 64.

    Args:
        symmetry: of the category, see `kfit.geometry.CATEGORIES`; with ``"y"`` the loss takes the turn about y that
            suits best.
        channels: of the convolutions, one at each size.
        num_bins: B.

    Raises:
        ValueError: for a symmetry of another name, or fewer than two bins.
    """

    centres: Tensor
    turns: Tensor

    def __init__(
        self, symmetry: Symmetry = "none", channels: Sequence[int] = (24, 48, 96, 160, 160), num_bins: int = 32
    ) -> None:
        super().__init__()
        check_choice("CoordinateRegressor: symmetry", symmetry, ("none", "y"))
        check_list("CoordinateRegressor: channels", channels, None, check_count, 1, 4096)
        check_count("CoordinateRegressor: num_bins", num_bins, 2, 1024)
        self.num_bins = num_bins
        self.register_buffer("centres", (torch.arange(num_bins) + 0.5) / num_bins - 0.5, persistent=False)
        count = NUM_TURNS if symmetry == "y" else 1
        self.register_buffer("turns", _turns(count), persistent=False)
        self.down = nn.ModuleList([_convolution(3, channels[0], 1)])
        self.up = nn.ModuleList()
        for a, b in pairwise(channels):
            self.down.append(nn.Sequential(_convolution(a, b, 2), _convolution(b, b, 1)))
            self.up.insert(0, _convolution(a + b, a, 1))
        self.say = nn.Conv2d(channels[0], 3 * num_bins, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Logits (N, 3, B, S, S) of the bins of x, y and z, from pictures (N, 3, S, S) in [0, 1] on white.

        Raises:
            ValueError: for pictures whose side is no multiple of 2 to the number of sizes less 1.
        """
        check_shape("image", image, ("N", 3, "S", "S"))
        if image.shape[-1] % 2 ** len(self.up) or image.shape[-2] % 2 ** len(self.up):
            raise ValueError(f"image: sides must be multiples of {2 ** len(self.up)}, got {tuple(image.shape[-2:])}")
        x, seen = 2 * image - 1, []
        for layer in self.down:
            x = layer(x)
            seen.append(x)
        for layer, beside in zip(self.up, reversed(seen[:-1]), strict=True):
            x = layer(torch.cat([F.interpolate(x, scale_factor=2.0), beside], 1))
        said = self.say(x)
        logits: Tensor = said.to(torch.promote_types(said.dtype, torch.float32)).unflatten(1, (3, self.num_bins))
        return logits

    @torch.no_grad()
    def coordinates(self, image: Tensor) -> Tensor:
        """Coordinates (N, 3, S, S) in box diagonals; they are meaningless outside of the object.

        The mean over the likeliest bin and its neighbours, weighed by their probabilities, so that bins leave no steps.
        """
        said = self(image).softmax(2)
        bins = torch.arange(self.num_bins, device=said.device)[:, None, None]
        near = said * ((bins - said.argmax(2, keepdim=True)).abs() <= 1)
        found: Tensor = torch.einsum("ncbhw,b->nchw", near, self.centres) / near.sum(2)
        return found

    def divergence(self, logits: Tensor, coordinates: Tensor, mask: Tensor) -> Tensor:
        """Return the mean cross-entropy of the true coordinates over pixels and axes, in nats.

        With a free turn it is the least over the true coordinates turned about y by k · 60°, k = 0 … 5 (NOCS, section
        5). One rotation is chosen for all pixels of an object.

        Args:
            logits: (N, 3, B, S, S), what ``forward`` gave.
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
            turned = torch.einsum("ij,njhw->nihw", turn, coordinates)
            bins = ((turned + 0.5) * self.num_bins).long().clamp(0, self.num_bins - 1)
            each = -log_share.gather(2, bins.unsqueeze(2)).squeeze(2).sum(1)
            losses.append((each * known).sum((1, 2)) / amount)
        return torch.stack(losses).amin(0)


def _convolution(a: int, b: int, stride: int) -> nn.Sequential:
    # The normalisation has the offset.
    return nn.Sequential(nn.Conv2d(a, b, 3, stride, 1, bias=False), nn.BatchNorm2d(b), nn.LeakyReLU(0.2))


def _turns(count: int) -> Tensor:
    """Rotations (count, 3, 3) about y, even over the circle from none on."""
    matrices = []
    for k in range(count):
        cos, sin = math.cos(2 * math.pi * k / count), math.sin(2 * math.pi * k / count)
        matrices.append([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    return torch.tensor(matrices)
