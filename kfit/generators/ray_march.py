"""Volume rendering along rays through grids of colour and density."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.core import Rendering

# Raw density outside the volume, e^-12 after the softplus: empty.
EMPTY = -6.0
SHARPNESS = 2.0
# Samples of smaller weight are skipped, except in training.
MIN_SAMPLE_WEIGHT = 1e-4


@dataclass(frozen=True)
class RayMarch:
    """Rays (N, H, W) through boxes [−1, 1]³: points past + d · along at K evenly spaced depths d, starting at near."""

    past: Tensor
    along: Tensor
    near: Tensor
    step: Tensor
    num_samples: int
    thickness: float

    def whole(self, volume: Tensor) -> Rendering:
        """Draw with all samples."""
        depths, grid = self._points()
        raw = F.grid_sample(volume, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
        share = _weights(self._optical(raw[:, 3], self.step[:, None]))
        mask = share.sum(1, keepdim=True)
        image = (share[:, None] * torch.sigmoid(raw[:, :3])).sum(2) + 1 - mask
        depth = (share * depths).sum(1, keepdim=True) / mask.clamp_min(1e-4)
        return Rendering(image=image, mask=mask, depth=depth)

    def where_it_counts(self, volume: Tensor) -> Rendering:
        """Draw with the few samples whose weight, by the density without gradient, is above `MIN_SAMPLE_WEIGHT`."""
        with torch.no_grad():
            density = F.grid_sample(volume[:, 3:].contiguous(), self._points()[1], align_corners=False)
            among = _weights(self._optical(density[:, 0], self.step[:, None]))
            visible = (among > MIN_SAMPLE_WEIGHT).flatten().nonzero()[:, 0]
        rows, _, height, width = among.shape
        row, pixel = visible // among[0].numel(), visible % (height * width)
        ray = row * (height * width) + pixel
        number = visible // (height * width) % self.num_samples
        step = self.step.flatten()[ray]
        depth = self.near.flatten()[ray] + (number.to(step) + 0.5) * step
        point = self.past.flatten(0, 2)[ray] + depth[:, None] * self.along.flatten(0, 2)[ray]
        raw = _sampled(volume, row, point)
        thickness = torch.zeros_like(among).flatten().index_put((visible,), self._optical(raw[3], step))
        share = _weights(thickness.view_as(among)).flatten()[visible]
        parts = torch.cat([share * torch.sigmoid(raw[:3]), share[None], (share * depth)[None]])
        sums = parts.new_zeros(5, rows * height * width).index_add(1, ray, parts)
        colour, mask, far = sums.view(5, rows, height, width).transpose(0, 1).split([3, 1, 1], 1)
        return Rendering(image=colour + 1 - mask, mask=mask, depth=far / mask.clamp_min(1e-4))

    def _points(self) -> tuple[Tensor, Tensor]:
        """Return depths (N, K, H, W) and points (N, K, H, W, 3) of all samples."""
        count = torch.arange(self.num_samples, dtype=self.near.dtype, device=self.near.device).view(-1, 1, 1) + 0.5
        depths = self.near[:, None] + count * self.step[:, None]
        return depths, self.past[:, None] + depths[..., None] * self.along[:, None]

    def _optical(self, raw: Tensor, step: Tensor) -> Tensor:
        return self.thickness * step * F.softplus(SHARPNESS * (raw + EMPTY))


def _weights(thickness: Tensor) -> Tensor:
    """Return the weights (N, K, H, W) of the samples in their pixels: the decrease of transmittance at each."""
    # The cumulative sum is a product of matrices, because `cumsum` along this axis is 10 × slower on a CPU.
    to_here = -torch.ones(2 * thickness.shape[1:2], dtype=thickness.dtype, device=thickness.device).tril()
    light = (to_here @ thickness.flatten(2)).exp().view_as(thickness)
    return torch.cat([1 - light[:, :1], light[:, :-1] - light[:, 1:]], 1)


def _sampled(volume: Tensor, row: Tensor, point: Tensor) -> Tensor:
    """Sample the volumes (N, C, D, H, W) at M points (M, 3) in [−1, 1], each in one row's volume; return (C, M).

    `grid_sample` takes the same number of points for each row, so the volumes are stacked to one, with gaps between
    them.
    """
    count, channels, deep = volume.shape[:3]
    stacked = F.pad(volume, (0, 0, 0, 0, 0, 1)).transpose(0, 1).flatten(1, 2)
    whole = count * (deep + 1)
    x, y, z = point.unbind(1)
    slab = row * (deep + 1) + (z + 1) * deep / 2
    grid = torch.stack([x, y, 2 * slab / whole - 1], 1)
    # On a CPU it divides the batch between threads, never one entry.
    parts = torch.get_num_threads() if volume.device.type == "cpu" else 1
    grid = F.pad(grid, (0, 0, 0, -len(grid) % parts)).view(parts, 1, 1, -1, 3)
    found = F.grid_sample(stacked.expand(parts, -1, -1, -1, -1), grid, padding_mode="zeros", align_corners=False)
    return found.transpose(0, 1).reshape(channels, -1)[:, : len(point)]
