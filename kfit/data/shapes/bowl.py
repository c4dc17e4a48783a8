"""Bowls: lathed bodies with an inside and a rim of their own, often with food in them, on a foot's ring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, contents, prints, textures, undersides
from kfit.data.shapes.primitives import circle, revolve, smooth

Span = tuple[float, float]


@dataclass(frozen=True)
class Form:
    """Outside radii at heights 0, 0.12, 0.35, 0.65, 1 of the body over the rim's, height over width, foot over height.

    ``wall`` is the range of the wall's thickness over the width, ``steel`` and ``wood`` the chances of a bowl of metal
    or wood, ``lobes`` the number of waves around, 0 where it is round.
    """

    radii: tuple[float, ...]
    height: Span
    foot: Span
    wall: Span = (0.012, 0.04)
    steel: float = 0.04
    wood: float = 0.0
    lobes: int = 0


SHAPES = {
    "hemisphere": Form((0.3, 0.55, 0.8, 0.95, 1.0), (0.4, 0.52), (0.0, 0.05)),
    "shallow": Form((0.5, 0.66, 0.82, 0.93, 1.0), (0.2, 0.32), (0.0, 0.1)),
    "flared": Form((0.4, 0.52, 0.66, 0.8, 1.0), (0.3, 0.45), (0.0, 0.15)),
    "deep": Form((0.55, 0.75, 0.9, 0.98, 1.0), (0.5, 0.68), (0.0, 0.08)),
    "footed": Form((0.32, 0.55, 0.8, 0.94, 1.0), (0.38, 0.52), (0.12, 0.2)),
    "straight": Form((0.75, 0.9, 0.94, 0.97, 1.0), (0.35, 0.55), (0.0, 0.05)),
    "conic": Form((0.38, 0.46, 0.6, 0.78, 1.0), (0.32, 0.48), (0.03, 0.14)),
    "cereal": Form((0.46, 0.6, 0.8, 0.94, 1.0), (0.36, 0.48), (0.03, 0.1), wall=(0.02, 0.04)),
    "rice": Form((0.4, 0.6, 0.84, 0.95, 1.0), (0.46, 0.58), (0.1, 0.18), wall=(0.02, 0.045)),
    "ramen": Form((0.36, 0.5, 0.7, 0.87, 1.0), (0.36, 0.46), (0.1, 0.2)),
    "mixing": Form((0.42, 0.66, 0.86, 0.97, 1.0), (0.42, 0.58), (0.0, 0.02), wall=(0.01, 0.018), steel=0.6),
    "salad": Form((0.45, 0.62, 0.8, 0.93, 1.0), (0.3, 0.42), (0.0, 0.06), wall=(0.025, 0.05), wood=0.45),
    "pasta": Form((0.36, 0.48, 0.58, 0.68, 1.0), (0.16, 0.24), (0.04, 0.14)),
    "coupe": Form((0.55, 0.76, 0.9, 0.97, 1.0), (0.17, 0.26), (0.02, 0.1)),
    "ramekin": Form((0.9, 0.97, 0.98, 0.99, 1.0), (0.42, 0.56), (0.0, 0.03), wall=(0.03, 0.05)),
    "dip": Form((0.62, 0.76, 0.88, 0.96, 1.0), (0.3, 0.44), (0.0, 0.05), wall=(0.035, 0.06)),
}
HELD_OUT_SHAPES = {
    "lipped": Form((0.4, 0.62, 0.78, 0.82, 1.0), (0.3, 0.45), (0.0, 0.1)),
    "closing": Form((0.5, 0.8, 1.0, 1.06, 1.0), (0.42, 0.6), (0.0, 0.08)),
    "pet": Form((1.22, 1.16, 1.1, 1.05, 1.0), (0.28, 0.38), (0.0, 0.02), wall=(0.03, 0.06), steel=0.3),
    "fluted": Form((0.45, 0.6, 0.76, 0.9, 1.0), (0.34, 0.48), (0.05, 0.12), lobes=12),
    "stemmed": Form((0.3, 0.42, 0.72, 0.92, 1.0), (0.4, 0.5), (0.28, 0.4)),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "plain": (textures.plain, 5.0),
    "two_tone": (textures.two_tone, 1.0),
    "rings": (textures.rings, 1.3),
    "speckle": (textures.speckle, 1.3),
    "gradient": (textures.gradient, 1.0),
    "dots": (textures.dots, 0.6),
    "marble": (textures.marble, 0.5),
    "wood": (textures.wood, 1.0),
    "emblem": (prints.emblem, 0.8),
    "picture": (prints.picture_print, 0.5),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "zigzag": (textures.zigzag, 1.0),
    "checks": (textures.checks, 0.7),
    "blotches": (textures.blotches, 1.0),
    "stripes": (textures.stripes, 1.0),
}


# Share of taught bowls whose shape belongs to no family, and of those whose pattern belongs to none.
FREE = 0.35


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A bowl in rim widths, to be normalised by the caller."""
    shapes, families = (HELD_OUT_SHAPES, HELD_OUT_TEXTURES) if held_out else (SHAPES, TEXTURES)
    form = shapes[str(rng.choice(list(shapes)))]
    if not held_out and rng.random() < FREE:
        form = _free(rng)
    radii, height = np.array(form.radii), float(rng.uniform(*form.height))
    if not held_out and rng.random() < 0.5:  # part-way to another family, so that a code learns ways to differ
        other = shapes[str(rng.choice(list(shapes)))]
        radii = radii + rng.uniform(0, 0.5) * (np.array(other.radii) - radii)
    wall, family = float(rng.uniform(*form.wall)), textures.choose(rng, families)
    if not held_out and rng.random() < FREE:
        family = textures.mixed
    base = colors.white(rng) if rng.random() < 0.35 else colors.any_color(rng, whites=0.1)
    steel = rng.random() < form.steel
    base = colors.metal(rng) if steel else base
    skin = (textures.wood if rng.random() < form.wood else family)(rng, base, (128, 448))
    inside = skin if steel else _inside(rng, base, skin, families)
    jitter = 1 + rng.normal(0, 0.02, len(radii))
    controls = np.stack([radii * 0.5 * jitter, np.array([0, 0.12, 0.35, 0.65, 1.0]) * height], axis=1)
    outer = smooth(controls, 26)
    section = circle(8 * form.lobes or 64)
    if form.lobes:
        section = section * (1 + 0.035 * np.cos(form.lobes * np.linspace(0, 2 * np.pi, len(section))[:, None]))
    lip = np.linspace(0, np.pi, 7)
    rim = np.stack([outer[-1, 0] - wall / 2 + wall / 2 * np.cos(lip), height + wall / 2 * np.sin(lip)], axis=1)
    kind = rng.random()
    rim_color = inside[:1].mean((0, 1)) / 255 if kind < 0.5 else base if kind < 0.75 else colors.any_color(rng)
    return join(
        [
            revolve(outer, skin, section=section),
            revolve(rim, textures.solid(rim_color), section=section),
            *_hollow(rng, outer, wall, inside, section),
            *_foot(rng, outer, height * float(rng.uniform(*form.foot)), wall, base, section),
        ]
    )


def _free(rng: np.random.Generator) -> Form:
    """A bowl of no family: it may widen or narrow towards the rim, bulge, and stand on a high foot.

    Without such bowls a pose head learns that the wide end is the rim.
    """
    levels = np.array([0, 0.12, 0.35, 0.65, 1.0])
    base, bulge = rng.uniform(0.3, 1.25), rng.uniform(-0.1, 0.15)
    rise = levels ** np.exp(rng.uniform(-1.2, 0.6))
    radii = base + (1 - base) * rise + bulge * np.sin(np.pi * levels)
    high = float(rng.uniform(0.0, 0.4)) if rng.random() < 0.4 else 0.0
    return Form(
        tuple(radii),
        height=(0.18, 0.65),
        foot=(0.8 * high, high),
        wall=(0.012, 0.06),
        steel=0.1,
        wood=0.1,
        lobes=int(rng.integers(6, 21)) if rng.random() < 0.1 else 0,
    )


def _hollow(
    rng: np.random.Generator, outer: np.ndarray, wall: float, tile: np.ndarray, section: np.ndarray
) -> list[Mesh]:
    """The inside, the outside moved in by the wall, down to a flat floor or to what is in it."""
    floor, top = outer[0, 1] + wall * 1.2, float(outer[-1, 1])
    filled = rng.random() < 0.4
    level = floor + (top - floor) * rng.uniform(0.3, 0.88) if filled else floor
    levels = np.linspace(top, level, 20)
    radius = np.maximum(np.interp(levels, outer[:, 1], outer[:, 0]) - wall, 0.05)
    if filled:
        room = (top - level) * rng.uniform(0.5, 1.0) + 0.06 * rng.random()
        # Food is round and reaches a little into the wall of a bowl with lobes.
        reach = float(radius[-1]) * (1.03 if np.ptp(np.hypot(*section.T)) > 0.01 else 1.0)
        inside = revolve(np.stack([radius, levels], axis=1), tile, section=section)
        return [inside, *contents.food(rng, reach, level, room)]
    steps = np.linspace(radius[-1], 0, 9)[1:]
    sag = 0.3 * wall * (1 - steps / radius[-1])
    profile = np.concatenate([np.stack([radius, levels], axis=1), np.stack([steps, floor - sag], axis=1)])
    return [revolve(profile, tile, section=section)]


def _foot(
    rng: np.random.Generator, outer: np.ndarray, tall: float, wall: float, color: np.ndarray, section: np.ndarray
) -> list[Mesh]:
    """A ring to stand on around a recess, or an underside that is hardly recessed; its edge is often bare clay."""
    floor = color * 0.95
    bare = colors.hue(rng, float(rng.uniform(0.05, 0.12)), (0.05, 0.4), (0.5, 0.9)) if rng.random() < 0.4 else floor
    if tall < 0.01:
        depth, width = wall * rng.uniform(0.2, 0.7), rng.uniform(0.06, 0.2)
        return undersides.standing_ring(rng, outer[0, 0], outer[0, 1], depth, (bare, floor), section, width)
    radius = outer[0, 0] * rng.uniform(0.85, 1.0)
    tile, edge = textures.solid(color * rng.uniform(0.85, 1.0)), radius * rng.uniform(0.95, 1.1)
    side = np.array([(edge, -tall), (radius, -tall / 2), (radius, 0.0), (radius, 0.02)])
    under = np.array([(radius * 0.9, outer[0, 1]), (outer[0, 0], outer[0, 1])])
    ring = undersides.standing_ring(rng, edge, -tall, tall * rng.uniform(0.4, 0.95), (bare, floor), section, 0.14)
    return [revolve(side, tile, section=section), revolve(under, tile, section=section), *ring]


def _inside(
    rng: np.random.Generator, base: np.ndarray, skin: np.ndarray, families: dict[str, tuple[textures.Family, float]]
) -> np.ndarray:
    """Texture of the inside: the outside's colour or pattern, white, another colour, or a pattern of its own."""
    kind = rng.random()
    if kind < 0.3:
        return textures.solid(base)
    if kind < 0.4:
        return skin
    if kind < 0.65:
        return textures.solid(colors.white(rng))
    if kind < 0.82:
        return textures.solid(colors.any_color(rng))
    return textures.choose(rng, families)(rng, colors.any_color(rng, 0.4), (128, 448))
