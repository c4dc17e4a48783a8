"""Ends of cans: seamed lids with ring-pulls and tabs, opened tins, slip, plastic and screw lids, and domed bottoms."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, contents, textures, undersides
from kfit.data.shapes.placing import shift, turn_x, turn_y
from kfit.data.shapes.primitives import circle, plate, revolve, smooth

AROUND = 44


def top(rng: np.random.Generator, kind: str, radius: float, at: float, tin: np.ndarray) -> list[Mesh]:
    """What closes a can of a radius at a height.

    Args:
        rng: Source of randomness.
        kind: seam, ring (with a ring-pull), tab (of a drink can), opened, slip, plastic, screw or spray.
        radius: Of the wall's upper end.
        at: Height of the wall's upper end.
        tin: Colour of the metal.
    """
    if kind in ("slip", "plastic", "screw"):
        return _lid(rng, kind, radius, at, tin)
    if kind == "spray":
        return [*seamed(rng, radius, at, 1, 0.02, 0.02, tin), *_spray_cap(rng, radius, at)]
    rim = radius * 0.036 * rng.uniform(0.6, 1.6)
    if kind == "opened":
        return _opened(rng, radius, at, rim, tin)
    depth = rim * (rng.uniform(2.0, 3.5) if kind == "tab" else rng.uniform(0.8, 2.5))
    parts = seamed(rng, radius, at, 1, rim, depth, tin)
    if kind == "seam":
        return parts
    return parts + (_tab if kind == "tab" else _ring_pull)(rng, radius - 1.6 * rim, at - depth + 0.004, tin)


def bottom(rng: np.random.Generator, kind: str, radius: float, color: np.ndarray) -> list[Mesh]:
    """The underside of a can that stands at 0: seam, dome (of a drink can) or glass (of a jar)."""
    if kind == "seam":
        rim = radius * 0.036 * rng.uniform(0.6, 1.4)
        return seamed(rng, radius, 0.0, -1, rim, rim * rng.uniform(0.8, 2.5), color)
    if kind == "glass":
        ring = (color * 0.95, color * 0.8)
        return undersides.standing_ring(rng, radius, 0.0, rng.uniform(0.02, 0.05), ring, circle(AROUND), 0.2)
    dome = rng.uniform(0.08, 0.16)
    return undersides.standing_ring(rng, radius, 0.0, 0.03, (color * 0.9, color), circle(AROUND), 0.06, dome)


def seamed(
    rng: np.random.Generator, radius: float, at: float, facing: int, rim: float, depth: float, color: np.ndarray
) -> list[Mesh]:
    """A seamed rim and the sunken end inside it, facing up (1) or down (−1)."""
    seam, wall = _rim(radius, at, facing, rim, depth)
    steps = np.linspace(wall[-1, 0], 0, 12)
    groove = 0.006 * np.sin(np.clip((steps / wall[-1, 0] - 0.55) / 0.3, 0, 1) * 2 * np.pi)
    disc = np.stack([steps, at - facing * (depth + groove)], axis=1)
    tile, dark = textures.solid(color), textures.solid(color * 0.8)
    profiles = [(seam, dark), (wall, tile), (disc, tile)]
    parts = [revolve(profile if facing > 0 else profile[::-1], tile, AROUND) for profile, tile in profiles]
    if facing < 0 and rng.random() < 0.5:
        mark = undersides.stamp(rng, color)
        parts.append(plate(circle(24) * wall[-1, 0] * 0.5, at + depth - 0.008, mark, facing=-1, num_rings=2))
    return parts


def _rim(radius: float, at: float, facing: int, rim: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Profiles of the seam and of the wall from its inner edge down to the end."""
    angle = np.linspace(-np.pi / 2, np.pi / 2 + 0.6, 9)
    seam = np.stack([radius - rim * 0.4 + rim * np.cos(angle), at + facing * (rim * np.sin(angle) - rim * 0.2)], axis=1)
    inside = radius - rim * 1.5
    wall = np.array([seam[-1], (inside, at), (inside - depth * 0.1, at - facing * depth)])
    return seam, wall


def _ring_pull(rng: np.random.Generator, radius: float, at: float, color: np.ndarray) -> list[Mesh]:
    """A tab with a round hole near the edge of the lid, in a random direction."""
    length, width = radius * rng.uniform(0.55, 0.8), radius * rng.uniform(0.2, 0.28)
    outer = circle(20) * [width, length / 2]
    hole = plate(circle(16) * width * 0.6, 0.024, textures.solid(color * 0.35), num_rings=2)
    parts = [
        plate(outer, 0.022, textures.solid(color * 0.92), num_rings=2),
        hole.transformed(shift(0, 0, -length * 0.2)),
        revolve(np.array([(1.0, 0.0), (1.0, 0.022)]), textures.solid(color * 0.7), section=outer),
    ]
    placed = turn_y(rng.uniform(0, 2 * np.pi)) @ shift(0, 0, radius * 0.95 - length / 2)
    return [part.transformed(shift(0, at, 0) @ placed) for part in parts]


def _tab(rng: np.random.Generator, radius: float, at: float, color: np.ndarray) -> list[Mesh]:
    """A drink can's tab on its rivet, before a mouth that is closed or open."""
    metal = color if rng.random() < 0.75 else colors.any_color(rng)
    length, width = radius * rng.uniform(0.62, 0.8), radius * rng.uniform(0.24, 0.32)
    outer = circle(24) * [width, length / 2]
    opened = rng.random() < 0.45
    lifted = turn_x(-rng.uniform(0.1, 0.5)) if opened and rng.random() < 0.5 else np.eye(4)
    dark, edge = textures.solid(metal * 0.4), textures.solid(metal * 0.7)
    hole = circle(16) * [width * 0.6, length * 0.16]
    rivet = revolve(np.array([(0.05, 0.03), (0.045, 0.04), (0.0, 0.042)]) * [radius * 3, 1], edge, 12)
    tab = [
        plate(outer, 0.03, textures.solid(metal * 0.95), num_rings=2).transformed(shift(0, 0, length * 0.3)),
        revolve(np.array([(1.0, 0.0), (1.0, 0.03)]), edge, section=outer).transformed(shift(0, 0, length * 0.3)),
        plate(hole, 0.032, dark, num_rings=2).transformed(shift(0, 0, length * 0.5)),
        rivet,
    ]
    tab = [part.transformed(lifted) for part in tab]
    mouth = circle(24) * [radius * 0.36, radius * 0.27]
    ground = textures.solid(color * (0.12 if opened else 0.85))
    line = plate(mouth * 1.1, 0.002, textures.solid(color * 0.6), num_rings=2)
    tab += [part.transformed(shift(0, 0, -radius * 0.55)) for part in (line, plate(mouth, 0.004, ground, num_rings=2))]
    placed = shift(0, at, 0) @ turn_y(rng.uniform(0, 2 * np.pi))
    return [part.transformed(placed) for part in tab]


def _opened(rng: np.random.Generator, radius: float, at: float, rim: float, tin: np.ndarray) -> list[Mesh]:
    """A tin without its lid, empty or with what is in it."""
    depth = radius * rng.uniform(0.15, 0.6)
    seam, wall = _rim(radius, at, 1, rim, depth)
    inside = textures.solid(tin * rng.uniform(0.7, 0.95))
    parts = [revolve(seam, textures.solid(tin * 0.85), AROUND), revolve(wall, inside, AROUND)]
    level, inner = at - depth, float(wall[-1, 0])
    if rng.random() < 0.8:
        parts += contents.food(rng, inner, level, depth * 0.8)
    else:
        parts.append(plate(circle(AROUND) * inner, level, inside))
    return parts


def _lid(rng: np.random.Generator, kind: str, radius: float, at: float, tin: np.ndarray) -> list[Mesh]:
    """A lid over the upper end: of tin, of plastic, or screwed onto a jar's neck."""
    color = {"slip": tin, "plastic": colors.white(rng), "screw": tin}[kind]
    if rng.random() < 0.55:
        color = colors.any_color(rng, whites=0.3)
    tile = textures.solid(color)
    wide = radius * rng.uniform(1.015, 1.05)
    tall = {"slip": rng.uniform(0.06, 0.4), "plastic": rng.uniform(0.06, 0.14), "screw": rng.uniform(0.14, 0.3)}[kind]
    rise = 0.02 if kind != "screw" else tall * 0.8
    side = np.array([(radius * 0.98, at + rise - tall), (wide, at + rise - tall), (wide, at + rise - 0.02)])
    bevel = smooth(np.array([(wide, at + rise - 0.02), (wide - 0.006, at + rise - 0.006), (wide - 0.02, at + rise)]), 4)
    sunk, ledge = rng.choice([0.0, 0.012, -0.012]), wide * rng.uniform(0.75, 0.92)
    step = np.array([(wide - 0.02, at + rise), (ledge, at + rise), (ledge * 0.98, at + rise - sunk)])
    skin = textures.stripes(rng, color, (8, 128)) if kind == "screw" and rng.random() < 0.4 else tile
    parts = [revolve(side[:2], tile, AROUND), revolve(side[1:], skin, AROUND), revolve(bevel, tile, AROUND)]
    face = undersides.stamp(rng, color) if rng.random() < 0.35 else tile
    parts.append(revolve(step, tile, AROUND))
    return [*parts, plate(circle(AROUND) * ledge * 0.98, at + rise - sunk, face)]


def _spray_cap(rng: np.random.Generator, radius: float, height: float) -> list[Mesh]:
    """An aerosol's plastic cap, or its bare button."""
    tile = textures.solid(colors.any_color(rng, 0.4))
    if rng.random() < 0.25:
        dome = smooth(np.array([(radius * 0.85, 0.0), (radius * 0.6, 0.1), (radius * 0.3, 0.14)]), 8)
        button = np.array([(radius * 0.3, 0.14), (radius * 0.28, 0.32)])
        end = plate(circle(20) * radius * 0.28, 0.32, tile, num_rings=2)
        parts = [revolve(dome, textures.solid(colors.metal(rng)), AROUND), revolve(button, tile, 20), end]
        return [part.transformed(shift(0, height - 0.02, 0)) for part in parts]
    tall, wide = rng.uniform(0.25, 0.6), radius * rng.uniform(0.55, 0.98)
    side = np.array([(wide, height - 0.03), (wide, height + tall * 0.5), (wide * 0.97, height + tall)])
    return [revolve(side, tile, AROUND), plate(circle(AROUND) * wide * 0.97, height + tall, tile)]
