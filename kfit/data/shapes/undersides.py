"""Undersides: what an object shows from below, from the axis out to the radius where its wall begins."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.primitives import circle, plate, revolve, sheet


def standing_ring(
    rng: np.random.Generator,
    radius: float,
    at: float,
    depth: float,
    ring: tuple[np.ndarray, np.ndarray],
    section: np.ndarray | None = None,
    width: float = 0.12,
    dome: float = 0.0,
    mark: float = 0.5,
) -> list[Mesh]:
    """A ring to stand on around a recessed floor.

    Args:
        rng: Source of randomness.
        radius: Outer radius of the ring, where the wall begins.
        at: The y on which the object stands.
        depth: Of the recess.
        ring: Colours of the ring and of the recess.
        section: Outline that a radius of 1 scales, a circle unless given.
        width: Of the ring over its radius.
        dome: How much higher than the recess's edge its centre is.
        mark: Chance of a stamp or small print on the floor.
    """
    outline = circle() if section is None else section
    inner, floor = radius * (1 - width), radius * (1 - width) * 0.95
    bare, tile = textures.solid(ring[0]), textures.solid(ring[1])
    contact = np.array([(inner, at), ((inner + radius) / 2, at), (radius, at)])
    wall = np.array([(floor, at + depth), ((floor + inner) / 2, at + depth * 0.6), (inner, at)])
    parts = [revolve(contact, bare, section=outline), revolve(wall, tile, section=outline)]
    if dome > 0:
        share = np.linspace(0, 1, 9)
        curve = np.stack([floor * share, at + depth + dome * (1 - share**2)], axis=1)
        return [*parts, revolve(curve, tile, section=outline)]
    floor_tile = stamp(rng, ring[1]) if rng.random() < mark else tile
    return [*parts, plate(outline * floor, at + depth, floor_tile, facing=-1)]


def stamp(rng: np.random.Generator, ground: np.ndarray) -> np.ndarray:
    """A maker's mark or small print in the middle of a floor."""
    picture = np.ascontiguousarray(np.broadcast_to(textures.as_texture(ground), (64, 64, 3)))
    ink = np.clip(ground * 0.6, 0, 1) if ground.mean() > 0.4 else np.clip(ground * 1.3 + 0.15, 0, 1)
    if rng.random() < 0.5:
        ink = colors.against(rng, ground)
    kind = rng.random()
    if kind < 0.4:
        prints.figure(rng, picture, (20, 20, 24, 24), ground)
    elif kind < 0.7:
        prints.write(rng, picture, (18, 14, 14, 36), ink)
    prints.lines(rng, picture, (38, 16, int(rng.integers(6, 16)), 32), ink)
    return picture


def petals(radius: float, at: float, depth: float, color: np.ndarray, count: int) -> list[Mesh]:
    """The base of a bottle for fizzy drinks: ``count`` feet around a raised centre."""
    share = np.linspace(0, 1, 14)[:, None]
    angle = np.linspace(0, 2 * np.pi, 12 * count + 1)[None]
    valley = (0.5 + 0.5 * np.cos(count * angle)) ** 2
    between = np.sin(np.pi * share) * 0.9 * valley
    rise = depth * np.maximum(np.clip(1 - 1.7 * share, 0, 1), between)
    points = np.stack([radius * share * np.sin(angle), at + rise, radius * share * np.cos(angle)], axis=-1)
    return [sheet(points, textures.solid(color))]
