"""Families of mugs, from espresso cups to steins and travel mugs, and of their handles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Span = tuple[float, float]


@dataclass(frozen=True)
class Form:
    """Outside radii at heights 0, 1/4, 1/2, 3/4, 1 of the body over its greatest, and the range of height over width.

    ``wall`` is the range of the wall's thickness over the width, ``lid`` the chance of a lid, ``steel`` that of a metal
    body, ``floor`` how high the inside's floor is at least, over the height, and ``sides`` the number of facets, 0
    where it is round.
    """

    radii: tuple[float, ...]
    height: Span
    wall: Span = (0.015, 0.045)
    lid: float = 0.0
    steel: float = 0.03
    floor: float = 0.0
    sides: int = 0


SHAPES = {
    "straight": Form((1.0, 1.0, 1.0, 1.0, 1.0), (0.85, 1.3)),
    "tapered": Form((0.78, 0.85, 0.91, 0.96, 1.0), (0.85, 1.3)),
    "upturned": Form((1.0, 0.98, 0.95, 0.91, 0.87), (0.85, 1.2)),
    "barrel": Form((0.82, 0.96, 1.0, 0.97, 0.88), (0.85, 1.2)),
    "flared": Form((0.72, 0.76, 0.82, 0.9, 1.0), (0.8, 1.3)),
    "cup": Form((0.45, 0.84, 0.95, 0.99, 1.0), (0.6, 0.85)),
    "low": Form((0.72, 0.95, 0.99, 1.0, 1.0), (0.5, 0.75)),
    "espresso": Form((0.68, 0.84, 0.94, 0.99, 1.0), (0.75, 1.0), wall=(0.04, 0.07)),
    "demitasse": Form((0.6, 0.66, 0.76, 0.88, 1.0), (0.7, 0.95)),
    "cappuccino": Form((0.4, 0.68, 0.87, 0.96, 1.0), (0.48, 0.65), wall=(0.025, 0.05)),
    "latte": Form((0.6, 0.76, 0.86, 0.94, 1.0), (1.05, 1.35)),
    "enamel": Form((0.97, 1.0, 1.0, 1.0, 1.0), (0.8, 1.0), wall=(0.01, 0.018)),
    "camping": Form((0.96, 0.98, 1.0, 1.0, 0.99), (0.85, 1.1), wall=(0.012, 0.02), steel=0.8),
    "travel": Form((0.74, 0.8, 0.9, 0.98, 1.0), (1.2, 1.42), lid=0.8, steel=0.5),
    "tumbler": Form((0.84, 0.92, 0.98, 1.0, 0.97), (1.1, 1.35), lid=0.7, steel=0.6),
    "stein": Form((1.0, 0.96, 0.92, 0.9, 0.88), (1.2, 1.45), wall=(0.04, 0.06)),
    "diner": Form((0.9, 0.94, 0.92, 0.93, 1.0), (0.85, 1.05), wall=(0.05, 0.075)),
    "soup": Form((0.6, 0.8, 0.92, 0.98, 1.0), (0.55, 0.7), wall=(0.025, 0.05)),
}
HELD_OUT_SHAPES = {
    "waisted": Form((0.96, 0.88, 0.82, 0.88, 1.0), (0.85, 1.3)),
    "tulip": Form((0.62, 0.9, 0.95, 0.92, 1.0), (0.8, 1.15)),
    "globe": Form((0.6, 0.94, 1.0, 0.92, 0.74), (0.8, 1.0)),
    "faceted": Form((0.86, 0.93, 0.97, 1.0, 1.0), (0.85, 1.2), sides=8),
    "pedestal": Form((0.62, 0.4, 0.8, 0.96, 1.0), (1.05, 1.3), floor=0.34),
    "commuter": Form((0.7, 0.72, 0.86, 1.0, 0.96), (1.2, 1.4), lid=0.9, steel=0.5),
}
# Handles as (outward, upward) controls from the lower to the upper joint: outward 1 is the full reach.
HANDLES = {
    "c": ((0.0, 0.0), (0.55, -0.05), (0.95, 0.22), (1.0, 0.5), (0.95, 0.78), (0.55, 1.05), (0.0, 1.0)),
    "d": ((0.0, 0.0), (0.45, 0.05), (0.85, 0.3), (1.0, 0.65), (0.9, 0.92), (0.5, 1.03), (0.0, 1.0)),
    "ear": ((0.0, 0.0), (0.3, 0.12), (0.65, 0.4), (0.95, 0.72), (0.9, 1.0), (0.5, 1.1), (0.0, 1.0)),
    "square": ((0.0, 0.0), (0.8, 0.0), (0.97, 0.03), (1.0, 0.15), (1.0, 0.85), (0.97, 0.97), (0.8, 1.0), (0.0, 1.0)),
    "low_loop": ((0.0, 0.0), (0.6, -0.12), (1.0, 0.15), (0.98, 0.42), (0.65, 0.72), (0.3, 0.9), (0.0, 1.0)),
    "thumb_rest": ((0.0, 0.0), (0.9, 0.25), (0.95, 0.6), (0.98, 0.92), (0.8, 0.98), (0.4, 0.96), (0.0, 0.95)),
    "ring": ((0.0, 0.28), (0.4, 0.2), (0.85, 0.32), (1.0, 0.6), (0.85, 0.88), (0.4, 1.0), (0.0, 0.92)),
    "long": ((0.0, -0.1), (0.5, -0.12), (0.85, 0.0), (0.95, 0.4), (0.95, 0.8), (0.8, 1.05), (0.45, 1.1), (0.0, 1.06)),
    "strap": ((0.0, 0.0), (0.7, 0.02), (0.9, 0.12), (0.92, 0.5), (0.92, 0.88), (0.7, 1.0), (0.0, 1.0)),
    "slanted": ((0.0, 0.0), (0.35, 0.0), (0.7, 0.2), (0.9, 0.55), (1.0, 0.9), (0.9, 1.02), (0.4, 1.0), (0.0, 1.0)),
}
HELD_OUT_HANDLES = {
    "triangle": ((0.0, 0.0), (0.3, 0.25), (0.65, 0.6), (0.95, 0.9), (0.97, 1.0), (0.85, 1.02), (0.4, 1.0), (0.0, 1.0)),
    "wing": ((0.0, 0.0), (0.5, 0.3), (0.9, 0.55), (1.0, 0.8), (1.0, 1.15), (0.75, 1.1), (0.3, 1.0), (0.0, 1.0)),
    "hook": ((0.5, 0.12), (0.72, 0.02), (0.92, 0.15), (1.0, 0.5), (0.95, 0.82), (0.6, 1.02), (0.0, 1.0)),
    "drop": ((0.0, 0.0), (0.75, -0.05), (1.0, 0.1), (0.92, 0.3), (0.6, 0.55), (0.35, 0.8), (0.15, 0.95), (0.0, 1.0)),
}


def free_form(rng: np.random.Generator) -> Form:
    """A body of no family: it may widen or narrow towards the rim, bulge or have a waist, and stand on a stem.

    A pose head that sees families alone learns them by heart: it has twice the loss on others.
    """
    levels = np.linspace(0, 1, 5)
    base, bulge = rng.uniform(0.45, 1.2), rng.uniform(-0.2, 0.25)
    radii = base + (1 - base) * levels ** np.exp(rng.uniform(-1, 0.7)) + bulge * np.sin(np.pi * levels)
    floor = 0.0
    if rng.random() < 0.12:
        radii[1] *= rng.uniform(0.45, 0.8)
        floor = 0.34
    low = float(rng.uniform(0.45, 1.4))
    return Form(
        tuple(radii / radii.max()),
        height=(low, low + 0.05),
        wall=(0.01, 0.075),
        lid=0.15,
        steel=0.12,
        floor=floor,
        sides=int(rng.integers(5, 13)) if rng.random() < 0.12 else 0,
    )


def free_handle(rng: np.random.Generator) -> np.ndarray:
    """A handle of no family, (K, 2) as in `HANDLES`: a loop that may lean, be square or pointed, or hang free below."""
    along = np.array([0, 0.12, 0.28, 0.5, 0.72, 0.88, 1.0])
    furthest = along ** np.exp(rng.uniform(-0.8, 0.8))  # where along the loop it reaches out most
    outward = np.sin(np.pi * furthest).clip(0) ** np.exp(rng.uniform(-1.3, 0.3))
    upward = along - rng.uniform(-0.15, 0.2) * np.sin(np.pi * along) * (1 - along)
    upward += rng.uniform(-0.15, 0.3) * np.sin(np.pi * along) * along
    loop = np.stack([outward / outward.max(), upward], axis=1)
    loop[1:-1] += rng.normal(0, 0.04, (5, 2))
    return loop[2:] if rng.random() < 0.1 else loop
