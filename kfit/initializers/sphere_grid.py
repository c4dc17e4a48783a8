"""Starts spread evenly over the directions from which an object can be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


class SphereGrid(Initializer):
    """Sets azimuth and elevation on a lattice over a part of the view sphere.

    A Fibonacci lattice: start s of S lies at sine of elevation evenly between the bounds' sines and at azimuth
    centre + width·(frac(s·φ) − ½), φ the golden ratio's fraction, so that equal areas hold equally many starts
    (Swinbank and Purser, "Fibonacci grids", 2006). With equal bounds of elevation the azimuths are evenly spaced,
    which is the paper's grid.

    Args:
        azimuth_deg: (low, high) in degrees.
        elevation_deg: (low, high) in degrees; equal for one ring.

    Raises:
        ValueError: for bounds in the wrong order or elevations beyond ±90°.
    """

    on = ("azimuth", "elevation")

    def __init__(
        self,
        azimuth_deg: tuple[float, float] = (-180.0, 180.0),
        elevation_deg: tuple[float, float] = (-15.0, 75.0),
    ) -> None:
        for name, (low, high), limit in (("azimuth_deg", azimuth_deg, 360), ("elevation_deg", elevation_deg, 90)):
            if low > high or low < -limit or high > limit:
                raise ValueError(f"SphereGrid: {name} must rise within ±{limit}, got ({low:g}, {high:g})")
        self.azimuth_deg, self.elevation_deg = azimuth_deg, elevation_deg

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        middle = (torch.arange(num_starts, dtype=torch.float64) + 0.5) / num_starts
        low, high = (math.sin(math.radians(angle)) for angle in self.elevation_deg)
        ring = low == high
        turn = middle if ring else (torch.arange(num_starts, dtype=torch.float64) * GOLDEN_ANGLE / (2 * math.pi)) % 1.0
        left, right = (math.radians(angle) for angle in self.azimuth_deg)
        azimuth = left + (right - left) * turn
        elevation = torch.asin((low + (high - low) * middle).clamp(-1, 1))
        count = observation.num_problems
        return {"azimuth": azimuth.repeat(count), "elevation": elevation.repeat(count)}
