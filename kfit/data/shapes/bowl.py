"""Bowls: lathed bodies seen into from above, so the inside has its own colour or pattern and the rim its own."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.primitives import revolve, smooth

# Outside radii at heights 0, 0.12, 0.35, 0.65, 1 of the body over the rim's, the range of height over width, and how
# tall the foot is over the height.
SHAPES = {
    "hemisphere": ((0.3, 0.55, 0.8, 0.95, 1.0), (0.4, 0.52), (0.0, 0.05)),
    "shallow": ((0.5, 0.66, 0.82, 0.93, 1.0), (0.2, 0.32), (0.0, 0.1)),
    "flared": ((0.4, 0.52, 0.66, 0.8, 1.0), (0.3, 0.45), (0.0, 0.15)),
    "deep": ((0.55, 0.75, 0.9, 0.98, 1.0), (0.5, 0.68), (0.0, 0.08)),
    "footed": ((0.32, 0.55, 0.8, 0.94, 1.0), (0.38, 0.52), (0.12, 0.2)),
    "straight": ((0.75, 0.9, 0.94, 0.97, 1.0), (0.35, 0.55), (0.0, 0.05)),
    "conic": ((0.38, 0.46, 0.6, 0.78, 1.0), (0.32, 0.48), (0.03, 0.14)),
}
HELD_OUT_SHAPES = {
    "lipped": ((0.4, 0.62, 0.78, 0.82, 1.0), (0.3, 0.45), (0.0, 0.1)),
    "closing": ((0.5, 0.8, 1.0, 1.06, 1.0), (0.42, 0.6), (0.0, 0.08)),
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


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A bowl in rim widths, to be normalised by the caller."""
    shapes, families = (HELD_OUT_SHAPES, HELD_OUT_TEXTURES) if held_out else (SHAPES, TEXTURES)
    radii, heights, feet = shapes[str(rng.choice(list(shapes)))]
    height, wall = float(rng.uniform(*heights)), float(rng.uniform(0.012, 0.04))
    family = textures.choose(rng, families)
    base = colors.white(rng) if rng.random() < 0.35 else colors.any_color(rng, whites=0.1)
    skin = family(rng, base, (128, 448))
    inside = _inside(rng, base, skin, families)
    jitter = 1 + rng.normal(0, 0.02, len(radii))
    controls = np.stack([np.array(radii) * 0.5 * jitter, np.array([0, 0.12, 0.35, 0.65, 1.0]) * height], axis=1)
    outer = smooth(controls, 28)
    lip = np.linspace(0, np.pi, 7)
    rim = np.stack([outer[-1, 0] - wall / 2 + wall / 2 * np.cos(lip), height + wall / 2 * np.sin(lip)], axis=1)
    kind = rng.random()
    rim_color = inside[:1].mean((0, 1)) / 255 if kind < 0.5 else base if kind < 0.75 else colors.any_color(rng)
    underside = np.stack([np.linspace(0, outer[0, 0], 5), np.full(5, outer[0, 1])], axis=1)
    return join(
        [
            revolve(outer, skin, 72),
            revolve(rim, textures.solid(rim_color), 72),
            revolve(_hollow(outer, wall), inside, 72),
            revolve(underside, textures.solid(base * 0.95), 72),
            *_foot(rng, outer, height * float(rng.uniform(*feet)), base),
        ]
    )


def _hollow(outer: np.ndarray, wall: float) -> np.ndarray:
    """Profile of the inside from the rim down to the axis: the outside moved in by the wall, with a flat floor."""
    floor = outer[0, 1] + wall * 1.2
    levels = np.linspace(outer[-1, 1], floor, 22)
    radius = np.maximum(np.interp(levels, outer[:, 1], outer[:, 0]) - wall, 0.05)
    steps = np.linspace(radius[-1], 0, 9)[1:]
    sag = 0.3 * wall * (1 - steps / radius[-1])
    return np.concatenate([np.stack([radius, levels], axis=1), np.stack([steps, floor - sag], axis=1)])


def _foot(rng: np.random.Generator, outer: np.ndarray, height: float, color: np.ndarray) -> list[Mesh]:
    """A ring to stand on, where there is one."""
    if height < 0.01:
        return []
    radius = outer[0, 0] * rng.uniform(0.85, 1.0)
    tile = textures.solid(color * rng.uniform(0.85, 1.0))
    side = np.array([(radius * rng.uniform(0.95, 1.1), -height), (radius, -height / 2), (radius, 0.02)])
    under = np.stack([np.linspace(0, side[0, 0], 4), np.full(4, -height)], axis=1)
    return [revolve(side, tile, 48), revolve(under, tile, 48)]


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
