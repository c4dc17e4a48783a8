"""Poses that a network thinks likely for the picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.core import Initializer, Observation, Variable, Variables, frozen
from kfit.core.check import check_choice, check_range
from kfit.geometry import PoseNetwork
from kfit.initializers.sphere_grid import GOLDEN_ANGLE

# Steps down in a score of log-probabilities: a bin near a start comes after all that are free, a start's own bin last.
NEAR, TAKEN = 1e4, 1e8


class PosePosterior(Initializer):
    """Sets azimuth and elevation by a network's distribution over poses.

    Without ``sample`` the starts are the distribution's peaks: the likeliest bin, then the likeliest of those at least
    ``apart_deg`` from it, and so on (greedy non-maximum suppression); when no bin is left, the next round takes bins
    between. A start lies within its bin at the mean of the 3 × 3 bins around. Where azimuth is free
    (A = 1), elevations lie at the quantiles (s + ½) / S and azimuths a golden angle apart.

    With ``sample`` each start is drawn from the distribution, evenly within its bin.

    Args:
        head: image (B, C, H, W) → log-probabilities (B, A, E).
        sample: draw the starts instead of taking the peaks.
        apart_deg: least √(Δazimuth² + Δelevation²) between two peaks, which for close poses is the angle of the
            rotation between them.

    Raises:
        ValueError: for a distance outside 0° to 180°.
    """

    on = ("azimuth", "elevation")

    def __init__(self, head: PoseNetwork, sample: bool = False, apart_deg: float = 15.0) -> None:
        check_choice("PosePosterior: sample", sample, (False, True))
        check_range("PosePosterior: apart_deg", apart_deg, 0, 180)
        self.head, self.sample, self.apart = frozen(head), sample, math.radians(apart_deg)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        with torch.no_grad():
            said = self.head(observation.image).double().cpu()
        azimuths, elevations = (bins.double().cpu() for bins in (self.head.azimuths, self.head.elevations))
        steps = torch.stack([_step(azimuths, 2 * math.pi), _step(elevations, math.pi)])
        if self.sample:
            uniform = torch.stack([torch.rand(num_starts, 3, generator=rng, dtype=torch.float64) for rng in rngs])
            bins = torch.searchsorted(said.exp().flatten(1).cumsum(1), uniform[..., 0].contiguous())
            bins = bins.clamp(max=said[0].numel() - 1)
            within = (uniform[..., 1:] - 0.5) * steps
        elif len(azimuths) == 1:
            return self._along(said[:, 0].exp(), elevations, steps[1], num_starts)
        else:
            bins = self._peaks(said, azimuths, elevations, num_starts)
            within = _local_means(said.exp()).flatten(2).mT.gather(1, bins[..., None].expand(-1, -1, 2)) * steps
        azimuth = azimuths[bins // len(elevations)] + within[..., 0]
        elevation = elevations[bins % len(elevations)] + within[..., 1]
        return {"azimuth": azimuth.flatten(), "elevation": elevation.flatten()}

    def _peaks(self, said: Tensor, azimuths: Tensor, elevations: Tensor, num_starts: int) -> Tensor:
        """Bins (B, S) of the starts, best first."""
        azimuth_offset = (azimuths[:, None] - azimuths + math.pi) % (2 * math.pi) - math.pi
        elevation_offset = elevations[:, None] - elevations
        distance = (
            torch.hypot(azimuth_offset[:, None, :, None], elevation_offset[None, :, None]).flatten(0, 1).flatten(1)
        )
        near = NEAR * (distance < self.apart) + TAKEN * torch.eye(len(distance), dtype=distance.dtype)
        score, picked = said.flatten(1), []
        for _ in range(num_starts):
            picked.append(score.argmax(1))
            score = score - near[picked[-1]]
        return torch.stack(picked, 1)

    @staticmethod
    def _along(share: Tensor, elevations: Tensor, step: Tensor, num_starts: int) -> Variables:
        """Even quantiles of the elevations' distribution (B, E), azimuths all around."""
        start = torch.arange(num_starts, dtype=torch.float64)
        quantile = ((start + 0.5) / num_starts).expand(len(share), -1).contiguous()
        edge = share.cumsum(1)
        bins = torch.searchsorted(edge, quantile).clamp(max=len(elevations) - 1)
        inside = 1 - (edge.gather(1, bins) - quantile) / share.gather(1, bins)
        elevation = elevations[bins] + (inside.clamp(0, 1) - 0.5) * step
        azimuth = (start * GOLDEN_ANGLE + math.pi) % (2 * math.pi) - math.pi
        return {"azimuth": azimuth.repeat(len(share)), "elevation": elevation.flatten()}


def _step(bins: Tensor, whole: float) -> Tensor:
    """Width of a bin; a single one spans the whole."""
    return bins[1] - bins[0] if len(bins) > 1 else bins.new_tensor(whole)


def _local_means(share: Tensor) -> Tensor:
    """Mean offset (B, 2, A, E), in bins, of the shares (B, A, E) in the 3 × 3 bins around each one."""
    around = F.pad(torch.cat([share[:, -1:], share, share[:, :1]], 1), (1, 1))
    offset = torch.tensor([-1.0, 0.0, 1.0], dtype=share.dtype)
    kernels = torch.stack([torch.ones(3, 3).to(share), offset[:, None].expand(3, 3), offset.expand(3, 3)])
    total, azimuth_offset, elevation_offset = F.conv2d(around[:, None], kernels[:, None]).unbind(1)
    # Beside a peak the mean is the peak's place; a start stays in its own bin.
    return (torch.stack([azimuth_offset, elevation_offset], 1) / total.clamp(min=1e-12)[:, None]).clamp(-0.5, 0.5)
