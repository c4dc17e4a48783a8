"""An answer in one line."""

from __future__ import annotations

import math

from kfit.pose import PoseResult


def describe(result: PoseResult) -> str:
    """One line that a person can read."""
    azimuth, elevation, roll = (math.degrees(float(result.fit.values[n][0])) for n in ("azimuth", "elevation", "roll"))
    turned = "" if result.symmetry == "y" else f"turned {_wrapped(azimuth):.0f}°, "
    sides = " × ".join(f"{100 * side:.0f}" for side in result.size)
    away, above, rolled = 100 * result.translation[2], _wrapped(elevation), _wrapped(roll)
    return (
        f"{result.category} {away:.0f} cm away, {turned}seen from {above:.0f}° above, rolled {rolled:.0f}°, "
        f"{sides} cm, confidence {100 * result.confidence:.0f} %"
    )


def _wrapped(degrees: float) -> float:
    return (degrees + 180) % 360 - 180
