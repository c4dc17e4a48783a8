"""Rotations at the peaks of a pose network's distribution."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables, frozen
from kfit.core.arguments import check_arguments
from kfit.geometry import angles_from_rotation, rotation_from_angles
from kfit.geometry.pose_network import PoseNetwork
from kfit.initializers.sphere_grid import GOLDEN_ANGLE

# Penalties in log-probability: bins near a start come after all free bins, and bins that hold a start come last.
NEAR, TAKEN = 1e4, 1e8
# Bins within this many standard deviations of a peak are averaged.
AROUND = 3.0


class PosePosterior(Initializer):
    """Set azimuth, elevation and roll at the peaks of a network's distribution over rotations.

    The first start is the likeliest bin, the next the likeliest of those at least ``apart_deg`` from it, and so on
    (greedy non-maximum suppression). When no bin is left, the next round takes bins in between. A start lies at the
    mean rotation of the bins within 3 σ of its peak, weighted by their probabilities: the rotation nearest to the
    weighted mean of the matrices (Markley et al., "Averaging quaternions", 2007). If azimuth is free, the vertical axes
    are averaged instead, and the starts' azimuths lie a golden angle apart.

    Args:
        head: image (B, 3, S, S) → log-probabilities of rotations.
        apart_deg: least angle between two peaks, in [0°, 180°].

    Raises:
        ValueError: if ``apart_deg`` is outside [0°, 180°].

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> from kfit.generators import PoseHead
        >>> from kfit.initializers import PosePosterior
        >>> start = PosePosterior(PoseHead(channels=(4, 4), hidden_dim=8))
        >>> found = start({}, Observation(torch.rand(2, 3, 64, 64)), 5, [])
        >>> {name: tuple(value.shape) for name, value in found.items()}
        {'azimuth': (10,), 'elevation': (10,), 'roll': (10,)}
    """

    on = ("azimuth", "elevation", "roll")

    def __init__(self, head: PoseNetwork, apart_deg: float = 20.0) -> None:
        check_arguments(PosePosterior, locals(), apart_deg=(0, 180))
        self.head, self.apart = frozen(head), math.radians(apart_deg)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        with torch.no_grad():
            log_probability = self.head.log_probabilities(observation)
            rotation = self._means(log_probability, self._peaks(log_probability, num_starts))
        azimuth, elevation, roll = angles_from_rotation(rotation.cpu())
        if self.head.symmetry == "y":
            start = torch.arange(num_starts, dtype=torch.float64).repeat(len(log_probability))
            azimuth = (start * GOLDEN_ANGLE + math.pi) % (2 * math.pi) - math.pi
        if not self.head.predicts_roll:
            roll = torch.zeros_like(roll)
        return {"azimuth": azimuth, "elevation": elevation, "roll": roll}

    def _peaks(self, log_probability: Tensor, num_starts: int) -> Tensor:
        """Return the bins (B · S,) of the starts, the likeliest of each problem first."""
        # Bins near the poles are small, so densities are compared.
        score, picked = (log_probability - self.head.log_volume).double(), []
        for _ in range(num_starts):
            best = score.argmax(1)
            picked.append(best)
            near = self.head.one_minus_cosine(self.head.rotations[best]) < 1 - math.cos(self.apart)
            score = score - NEAR * near
            score[torch.arange(len(score), device=score.device), best] -= TAKEN
        return torch.stack(picked, 1).flatten()

    def _means(self, log_probability: Tensor, peaks: Tensor) -> Tensor:
        """Return the mean rotations (B · S, 3, 3) around the peaks."""
        rotations = self.head.rotations
        probability = log_probability.double().exp().repeat_interleave(len(peaks) // len(log_probability), 0)
        probability = probability.clamp_min(1e-12)  # an unlikely peak's bins may underflow
        least = math.cos(AROUND * self.head.sigma)
        if self.head.symmetry == "y":
            near = self.head.one_minus_cosine(rotations[peaks]) < 1 - least
            return _with_axis((near * probability) @ rotations.double()[:, :, 1])
        mean = probability.new_zeros(len(peaks), 3, 3)
        for bins in self.head.equivalent_rotations():  # of a symmetric object those that lie near the peak as they are
            near = (rotations[peaks].flatten(1) @ bins.flatten(1).mT - 1) / 2 > least
            mean = mean + ((near * probability) @ bins.double().flatten(1)).unflatten(1, (3, 3))
        failed = mean.isnan().any(-1, keepdim=True).any(-2, keepdim=True)
        left, _, right = torch.linalg.svd(mean.masked_fill(failed, 0.0))
        turn = torch.ones_like(mean[:, 0])
        turn[:, 2] = torch.det(left @ right)
        nearest: Tensor = (left * turn[:, None] @ right).masked_fill(failed, torch.nan)
        return nearest


def _with_axis(axis: Tensor) -> Tensor:
    """Return rotations (N, 3, 3) of azimuth 0 whose vertical axes point along (N, 3)."""
    x, y, z = axis.unbind(1)
    roll = torch.atan2(-x, y)
    elevation = torch.atan2(z, torch.hypot(x, y))
    return rotation_from_angles(torch.zeros_like(roll), elevation, roll)
