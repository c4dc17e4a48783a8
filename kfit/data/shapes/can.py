"""Cans: food and drink tins with labels, rims, beads and ring-pulls; symmetric about y but for label and tab."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.placing import shift, turn_y
from kfit.data.shapes.primitives import circle, plate, revolve


@dataclass(frozen=True)
class Form:
    """Height over width, radii of the ends over the wall's, a shoulder's share of the height, number of beads."""

    height: tuple[float, float]
    end: tuple[float, float]
    shoulder: tuple[float, float]
    beads: tuple[int, int]


SHAPES = {
    "food": Form((1.2, 1.6), (0.97, 1.0), (0.01, 0.02), (0, 1)),
    "ribbed": Form((1.2, 1.6), (0.97, 1.0), (0.01, 0.02), (5, 14)),
    "drink": Form((1.7, 2.1), (0.78, 0.88), (0.06, 0.1), (0, 1)),
    "slim": Form((2.2, 2.8), (0.82, 0.92), (0.04, 0.07), (0, 1)),
    "tuna": Form((0.35, 0.55), (0.94, 1.0), (0.02, 0.05), (0, 1)),
    "wide": Form((0.85, 1.15), (0.96, 1.0), (0.01, 0.03), (0, 3)),
}
HELD_OUT_SHAPES = {
    "aerosol": Form((2.0, 3.0), (0.9, 1.0), (0.02, 0.03), (0, 1)),
    "paint": Form((0.95, 1.25), (1.0, 1.0), (0.01, 0.02), (1, 3)),
    "flat": Form((0.55, 0.8), (0.93, 1.0), (0.02, 0.05), (2, 5)),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "label": (prints.label, 5.0),
    "plain": (textures.plain, 0.7),
    "emblem": (prints.emblem, 1.5),
    "lettering": (prints.lettering, 1.5),
    "two_tone": (textures.two_tone, 0.8),
    "rings": (textures.rings, 0.8),
    "gradient": (textures.gradient, 0.7),
    "picture": (prints.picture_print, 1.0),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "stripes": (textures.stripes, 1.0),
    "checks": (textures.checks, 0.7),
    "blotches": (textures.blotches, 0.7),
    "marble": (textures.marble, 0.7),
}


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A can in body widths, to be normalised by the caller."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    name = str(rng.choice(list(shapes)))
    form = shapes[name]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    height = float(rng.uniform(*form.height))
    end, shoulder = 0.5 * rng.uniform(*form.end), height * rng.uniform(*form.shoulder)
    tin = colors.metal(rng)
    base = tin if rng.random() < 0.15 else colors.any_color(rng, whites=0.25)
    wall = _wall(rng, height, end, shoulder, int(rng.integers(*form.beads)))
    inner = wall[(wall[:, 1] >= shoulder) & (wall[:, 1] <= height - shoulder)]
    low, high = wall[wall[:, 1] <= inner[0, 1]], wall[wall[:, 1] >= inner[-1, 1]]
    neck = textures.solid(tin if rng.random() < 0.75 else base)
    rim = 0.018 * rng.uniform(0.6, 1.6)
    depth = rim * rng.uniform(0.8, 2.5)
    parts = [revolve(inner, family(rng, base, (224, 448)), 48), revolve(low, neck, 48), revolve(high, neck, 48)]
    for at, facing in ((height, 1), (0.0, -1)):
        parts += _end(rng, end, at, facing, rim, depth, tin)
    if held_out and name == "aerosol":
        parts += _cap(rng, end, height)
    elif rng.random() < 0.6:
        parts += _ring_pull(rng, end, height - depth + 0.004, tin)
    return join(parts)


def _wall(rng: np.random.Generator, height: float, end: float, shoulder: float, beads: int) -> np.ndarray:
    """Profile of the side: shoulders at both ends, and beads pressed around the middle."""
    levels = np.linspace(0, height, 72 if beads > 1 else 30)
    low = np.clip(1 - levels / max(shoulder * rng.uniform(0.6, 1.0), 1e-6), 0, 1)
    high = np.clip(1 - (height - levels) / shoulder, 0, 1)
    radius = 0.5 - (0.5 - end) * np.maximum(low, high) ** 1.3
    if beads:
        middle = (levels / height - 0.5) / rng.uniform(0.25, 0.38)
        wave = 0.5 - 0.5 * np.cos(2 * np.pi * beads * (middle + 1) / 2)
        radius -= 0.012 * wave * (np.abs(middle) < 1)
    return np.stack([radius, levels], axis=1)


def _end(
    rng: np.random.Generator, radius: float, at: float, facing: int, rim: float, depth: float, color: np.ndarray
) -> list[Mesh]:
    """A seamed rim and the sunken end inside it, facing up (1) or down (−1)."""
    angle = np.linspace(-np.pi / 2, np.pi / 2 + 0.6, 9)
    seam = np.stack([radius - rim * 0.4 + rim * np.cos(angle), at + facing * (rim * np.sin(angle) - rim * 0.2)], axis=1)
    inside = radius - rim * 1.5
    wall = np.array([(inside, at), (inside - depth * 0.1, at - facing * depth)])
    steps = np.linspace(inside - depth * 0.1, 0, 12)
    groove = 0.006 * np.sin(np.clip((steps / inside - 0.55) / 0.3, 0, 1) * 2 * np.pi)
    disc = np.stack([steps, at - facing * (depth + groove)], axis=1)
    tile, dark = textures.solid(color), textures.solid(color * 0.8)
    profiles = [(seam, dark), (wall, tile), (disc, tile)]
    return [revolve(profile if facing > 0 else profile[::-1], tile, 48) for profile, tile in profiles]


def _ring_pull(rng: np.random.Generator, radius: float, at: float, color: np.ndarray) -> list[Mesh]:
    """A tab with a hole and, on drink cans, a dark opening before it; it points along a random direction."""
    length, width = radius * rng.uniform(0.55, 0.9), radius * rng.uniform(0.2, 0.3)
    outer = circle(20) * [width, length / 2]
    angle = rng.uniform(0, 2 * np.pi)
    offset = radius * rng.uniform(0.0, 0.25)
    tab = [
        plate(outer, 0.022, textures.solid(color * 0.92)),
        plate(circle(16) * width * 0.55, 0.024, textures.solid(color * 0.35)),
    ]
    tab[1] = tab[1].transformed(shift(0, 0, length * 0.2))
    edge = np.array([(1.0, 0.0), (1.0, 0.022)])
    tab.append(revolve(edge, textures.solid(color * 0.7), section=outer))
    if rng.random() < 0.35:
        mouth = plate(circle(20) * [width * 1.2, length * 0.35], 0.006, textures.solid(color * rng.uniform(0.2, 0.9)))
        tab.append(mouth.transformed(shift(0, 0, -length * 0.55)))
    return [part.transformed(shift(0, at, 0) @ turn_y(angle) @ shift(0, 0, offset)) for part in tab]


def _cap(rng: np.random.Generator, radius: float, height: float) -> list[Mesh]:
    """An aerosol's plastic cap."""
    tall, wide = rng.uniform(0.25, 0.6), radius * rng.uniform(0.55, 0.98)
    tile = textures.solid(colors.any_color(rng, 0.4))
    side = np.array([(wide, height - 0.03), (wide, height + tall * 0.5), (wide * 0.97, height + tall)])
    top = np.stack([np.linspace(wide * 0.97, 0, 6), np.full(6, height + tall)], axis=1)
    return [revolve(side, tile, 48), revolve(top, tile, 48)]
