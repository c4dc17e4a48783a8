"""Starts evenly distributed over viewing directions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_rising

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
# The root of x³ = x + 1; its inverse powers are the steps of a two-dimensional lattice, like the golden ratio's in one.
PLASTIC = 1.324717957244746


class SphereGrid(Initializer):
    """Set azimuth and elevation, and optionally roll, on a lattice over a part of the view sphere.

    A Fibonacci lattice: start s of S lies at a sine of elevation that is evenly spaced between the bounds' sines, and
    at azimuth left + width · frac(s·φ), φ the golden ratio's fraction, so that equal areas hold equally many starts
    (Swinbank and Purser, "Fibonacci grids", 2006). With roll, azimuth and roll step by 1/ρ and 1/ρ², ρ the plastic
    number (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018), so that equal volumes of
    rotations hold equally many. A variable whose bounds are equal keeps that value. If elevation is fixed, the azimuths
    are evenly spaced, which is the paper's grid; if both are fixed, the rolls are.

    Args:
        azimuth_deg: (low, high) in degrees; a category's are `kfit.geometry.Category.azimuth_deg`.
        elevation_deg: (low, high) in degrees; equal for one ring.
        roll_deg: (low, high) in degrees; None leaves roll to another initializer.

    Raises:
        ValueError: if bounds are in the wrong order, elevations lie beyond ±90°, or other angles beyond ±360°.

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> from kfit.initializers import SphereGrid
        >>> start = SphereGrid(elevation_deg=(30, 30))
        >>> start({}, Observation(torch.ones(1, 3, 64, 64)), 4, [])["azimuth"].rad2deg()
        tensor([-135.,  -45.,   45.,  135.], dtype=torch.float64)
    """

    def __init__(
        self,
        azimuth_deg: tuple[float, float] = (-180.0, 180.0),
        elevation_deg: tuple[float, float] = (-15.0, 75.0),
        roll_deg: tuple[float, float] | None = None,
    ) -> None:
        self.bounds_deg = {"azimuth": azimuth_deg, "elevation": elevation_deg}
        if roll_deg is not None:
            self.bounds_deg["roll"] = roll_deg
        for name, bounds in self.bounds_deg.items():
            limit = 90 if name == "elevation" else 360
            check_rising(f"SphereGrid: {name}_deg", bounds, -limit, limit)
        self.on = tuple(self.bounds_deg)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        start = torch.arange(num_starts, dtype=torch.float64)
        order: tuple[str, ...] = ("elevation", "azimuth", "roll")
        ranges = {name: self.bounds_deg[name] for name in order if name in self.on}
        free = [name for name, (low, high) in ranges.items() if low < high]
        steps = [GOLDEN_ANGLE / (2 * math.pi)] if len(free) < 3 else [1 / PLASTIC, 1 / PLASTIC**2]
        # The first free variable is divided evenly; the others step by irrational fractions of their ranges.
        lattice = [(start + 0.5) / num_starts, *((start * step) % 1.0 for step in steps)]
        share = {name: torch.zeros_like(start) for name in ranges} | dict(zip(free, lattice, strict=False))
        values = {}
        for name in self.on:
            low, high = (math.radians(angle) for angle in ranges[name])
            if name == "elevation":
                height = math.sin(low) + (math.sin(high) - math.sin(low)) * share[name]
                values[name] = torch.asin(height.clamp(-1, 1))
            else:
                values[name] = low + (high - low) * share[name]
        return {name: value.repeat(observation.num_problems) for name, value in values.items()}
