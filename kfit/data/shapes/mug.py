"""Mugs: a lathed body with an inside of its own colour and a swept handle along +x, NOCS's side for it."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.primitives import revolve, smooth, tube

Profile = tuple[tuple[float, ...], tuple[float, float]]

# Outside radius at heights 0, 1/4, 1/2, 3/4, 1 of the body over its greatest, and the range of height over width.
SHAPES = {
    "straight": ((1.0, 1.0, 1.0, 1.0, 1.0), (0.85, 1.35)),
    "tapered": ((0.78, 0.85, 0.91, 0.96, 1.0), (0.85, 1.35)),
    "upturned": ((1.0, 0.98, 0.95, 0.91, 0.87), (0.85, 1.2)),
    "barrel": ((0.82, 0.96, 1.0, 0.97, 0.88), (0.85, 1.2)),
    "flared": ((0.72, 0.76, 0.82, 0.9, 1.0), (0.8, 1.3)),
    "cup": ((0.45, 0.84, 0.95, 0.99, 1.0), (0.6, 0.85)),
    "low": ((0.72, 0.95, 0.99, 1.0, 1.0), (0.5, 0.75)),
}
HELD_OUT_SHAPES = {
    "waisted": ((0.96, 0.88, 0.82, 0.88, 1.0), (0.85, 1.3)),
    "tulip": ((0.62, 0.9, 0.95, 0.92, 1.0), (0.8, 1.15)),
}
# Handles as (outward, upward) controls from the lower to the upper joint: outward 1 is the full reach.
HANDLES = {
    "c": ((0.0, 0.0), (0.55, -0.05), (0.95, 0.22), (1.0, 0.5), (0.95, 0.78), (0.55, 1.05), (0.0, 1.0)),
    "d": ((0.0, 0.0), (0.45, 0.05), (0.85, 0.3), (1.0, 0.65), (0.9, 0.92), (0.5, 1.03), (0.0, 1.0)),
    "ear": ((0.0, 0.0), (0.3, 0.12), (0.65, 0.4), (0.95, 0.72), (0.9, 1.0), (0.5, 1.1), (0.0, 1.0)),
    "square": ((0.0, 0.0), (0.8, 0.0), (0.97, 0.03), (1.0, 0.15), (1.0, 0.85), (0.97, 0.97), (0.8, 1.0), (0.0, 1.0)),
    "low_loop": ((0.0, 0.0), (0.6, -0.12), (1.0, 0.15), (0.98, 0.42), (0.65, 0.72), (0.3, 0.9), (0.0, 1.0)),
}
HELD_OUT_HANDLES = {
    "triangle": ((0.0, 0.0), (0.3, 0.25), (0.65, 0.6), (0.95, 0.9), (0.97, 1.0), (0.85, 1.02), (0.4, 1.0), (0.0, 1.0)),
    "wing": ((0.0, 0.0), (0.5, 0.3), (0.9, 0.55), (1.0, 0.8), (1.0, 1.15), (0.75, 1.1), (0.3, 1.0), (0.0, 1.0)),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "plain": (textures.plain, 5.0),
    "two_tone": (textures.two_tone, 1.0),
    "rings": (textures.rings, 1.0),
    "stripes": (textures.stripes, 0.6),
    "dots": (textures.dots, 0.6),
    "speckle": (textures.speckle, 1.2),
    "gradient": (textures.gradient, 0.8),
    "marble": (textures.marble, 0.4),
    "emblem": (prints.emblem, 2.0),
    "lettering": (prints.lettering, 1.5),
    "picture": (prints.picture_print, 2.0),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "checks": (textures.checks, 1.0),
    "zigzag": (textures.zigzag, 1.0),
    "blotches": (textures.blotches, 1.0),
    "label": (prints.label, 1.0),
}


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A mug in body widths, to be normalised by the caller."""
    # Training blends families and bends what comes out, so that a code learns ways to differ rather than a list of
    # shapes; the held-out families stay pure.
    blend = 0.0 if held_out else rng.uniform(0, 1)
    profiles, loops = _pairs(rng, held_out)
    radii, heights = ((1 - blend) * np.array(a) + blend * np.array(b) for a, b in zip(*profiles, strict=True))
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    height, wall = rng.uniform(*heights), rng.uniform(0.015, 0.045)
    outer = _outside(rng, radii * 0.5, height, 0.015 if held_out else 0.05)
    base = colors.white(rng) if rng.random() < 0.4 else colors.any_color(rng, whites=0.15)
    skin = family(rng, base, (192, 448))
    inside_color = _inside(rng, base)
    rim_color = inside_color if rng.random() < 0.5 else base
    if rng.random() < 0.12:
        rim_color = colors.against(rng, base)
    lip = np.linspace(0, np.pi, 7)
    top_radius, middle = outer[-1, 0], wall / 2
    rim = np.stack([top_radius - middle + middle * np.cos(lip), height + middle * np.sin(lip)], axis=1)
    parts = [
        revolve(_foot(outer), textures.solid(base * rng.uniform(0.85, 1)), 64),
        revolve(outer, skin, 64),
        revolve(rim, textures.solid(rim_color), 64),
        *_hollow(rng, outer, wall, inside_color),
    ]
    handle_color = base if rng.random() < 0.8 else colors.against(rng, base)
    if rng.random() < 0.15:
        handle_color = inside_color
    loop = (1 - blend) * smooth(loops[0], 36) + blend * smooth(loops[1], 36)
    parts.append(_handle(rng, loop, outer, height, wall, handle_color))
    return join(parts)


def _pairs(rng: np.random.Generator, held_out: bool) -> tuple[list[Profile], list[np.ndarray]]:
    """Two profiles and two handles to blend, the handles bent a little in training."""
    shapes, handles = (HELD_OUT_SHAPES, HELD_OUT_HANDLES) if held_out else (SHAPES, HANDLES)
    loops = [np.array(handles[str(rng.choice(list(handles)))]) for _ in range(2)]
    if not held_out:
        for loop in loops:
            loop[1:-1] += rng.normal(0, 0.05, (len(loop) - 2, 2))
    return [shapes[str(rng.choice(list(shapes)))] for _ in range(2)], loops


def _outside(rng: np.random.Generator, radii: np.ndarray, height: float, bend: float) -> np.ndarray:
    """Profile (P, 2) of the outside, climbing from the rounded foot to the rim, its radii bent at random by a share."""
    jitter = 1 + rng.normal(0, bend, len(radii))
    curve = smooth(np.stack([radii * jitter, np.linspace(0, height, len(radii))], axis=1), 28)
    curve[:, 0] *= 0.5 / curve[:, 0].max()
    corner = rng.uniform(0.0, 0.12) * height
    lifted = np.clip(1 - curve[:, 1] / max(corner, 1e-6), 0, 1)
    curve[:, 0] -= corner * 0.8 * (1 - np.sqrt(1 - lifted**2))
    return curve


def _foot(outer: np.ndarray) -> np.ndarray:
    """Profile of the underside, from the axis to the wall."""
    return np.stack([np.linspace(0, outer[0, 0], 4), np.full(4, outer[0, 1])], axis=1)


def _hollow(rng: np.random.Generator, outer: np.ndarray, wall: float, color: np.ndarray) -> list[Mesh]:
    """The inside: a wall that follows the outside and a floor with a rounded edge."""
    floor = outer[0, 1] + wall * rng.uniform(1.0, 2.0)
    levels = np.linspace(outer[-1, 1], floor, 24)
    radius = np.interp(levels, outer[:, 1], outer[:, 0]) - wall
    bend = rng.uniform(0.05, 0.25) * radius.min()
    lifted = np.clip(1 - (levels - floor) / bend, 0, 1)
    radius = radius - bend * (1 - np.sqrt(1 - lifted**2))
    tile = textures.solid(color)
    disc = np.stack([np.linspace(radius[-1], 0, 7), np.full(7, floor)], axis=1)
    return [revolve(np.stack([radius, levels], axis=1), tile, 64), revolve(disc, tile, 64)]


def _handle(
    rng: np.random.Generator,
    shape: np.ndarray,
    outer: np.ndarray,
    height: float,
    wall: float,
    color: np.ndarray,
) -> Mesh:
    """The handle along +x, its ends sunk half-way into the wall: ``shape`` (36, 2) is its (outward, upward) path."""
    low, high = height * rng.uniform(0.1, 0.28), height * rng.uniform(0.72, 0.93)
    if height < 0.7:
        low, high = height * rng.uniform(0.2, 0.35), height * rng.uniform(0.8, 0.95)
    reach = rng.uniform(0.28, 0.46)
    path_y = low + (high - low) * shape[:, 1]
    foot, top = (np.interp(y, outer[:, 1], outer[:, 0]) - wall / 2 for y in (low, high))
    path_x = foot + (top - foot) * np.clip(shape[:, 1], 0, 1) + (reach + wall / 2) * shape[:, 0]
    path = np.stack([path_x, path_y, np.zeros(len(shape))], axis=1)
    thick, wide = rng.uniform(0.035, 0.065), rng.uniform(0.045, 0.1)
    swell = 1 + rng.uniform(0, 0.35) * np.abs(np.linspace(-1, 1, 36)) ** 4
    radii = np.stack([thick * swell, wide * swell], axis=1)
    return tube(path, radii, textures.solid(color), 14)


def _inside(rng: np.random.Generator, base: np.ndarray) -> np.ndarray:
    """Colour of the inside: often the outside's, often white, sometimes another."""
    kind = rng.random()
    if kind < 0.4:
        return base
    if kind < 0.75:
        return colors.white(rng)
    return colors.any_color(rng)
