"""Where a depth camera saw the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_range

# How far a seen surface lies before the centre of its object, in box diagonals.
BEFORE = 0.2


class FromDepth(Initializer):
    """Sets `kfit.generators.MetricDepth`'s distance and focal by the observed depth and the camera.

    φ = f / w with f the mean of the observation's focal lengths and w = unit_fraction · width of its picture;
    t = median of the known (finite) depth · (1 + 0.2 / φ), since what is seen lies before the object's centre. Of
    several pictures, those in which no depth is known have no distance: their starts are NaN.

    Args:
        unit_fraction: width of a unit diagonal over the picture's, at scale 1.

    Raises:
        ValueError: for a fraction outside [0.1, 10] and, when it is called, for an observation without depth or
            intrinsics, or in whose pictures no depth is known.
    """

    on = ("distance", "focal")

    def __init__(self, unit_fraction: float) -> None:
        check_range("FromDepth: unit_fraction", unit_fraction, 0.1, 10.0)
        self.unit_fraction = unit_fraction

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        intrinsics, depth = observation.field("intrinsics"), observation.field("depth").flatten(1)
        known = depth.isfinite()
        if not bool(known.any()):
            raise ValueError("FromDepth: depth must be known somewhere, got pictures in which it is nowhere")
        width = self.unit_fraction * observation.image.shape[-1]
        focal = (intrinsics[:, 0, 0] + intrinsics[:, 1, 1]) / 2 / width
        distance = depth.where(known, torch.nan).nanmedian(1).values * (1 + BEFORE / focal)
        found = {"distance": distance, "focal": focal}
        return {name: value.to(depth).repeat_interleave(num_starts) for name, value in found.items()}
