"""Mugs: a lathed body with an inside of its own colour, often a drink or a lid, and a handle along +x, NOCS's side."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, contents, mug_forms, prints, textures, undersides
from kfit.data.shapes.mug_forms import HANDLES, HELD_OUT_HANDLES, HELD_OUT_SHAPES, SHAPES, Form
from kfit.data.shapes.placing import shift
from kfit.data.shapes.primitives import circle, plate, polygon, revolve, smooth, tube

AROUND = 56
# Share of taught mugs that belong to no family.
FREE = 0.4
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
    blend = 0.0 if held_out else max(0.0, rng.uniform(-0.4, 0.6))
    form, other, loops = _pairs(rng, held_out)
    if not held_out and rng.random() < FREE:
        form, blend, loops = mug_forms.free_form(rng), 0.0, [mug_forms.free_handle(rng)] * 2
    radii = (1 - blend) * np.array(form.radii) + blend * np.array(other.radii)
    height = (1 - blend) * rng.uniform(*form.height) + blend * rng.uniform(*other.height)
    family, wall = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES), rng.uniform(*form.wall)
    outer = _outside(rng, radii * 0.5, height, 0.015 if held_out else 0.05)
    section = polygon([tuple(corner) for corner in circle(form.sides)[:-1]], 7) if form.sides else circle(AROUND)
    steel = rng.random() < form.steel
    base = colors.metal(rng) if steel else colors.white(rng) if rng.random() < 0.4 else colors.any_color(rng, 0.15)
    skin = family(rng, base, (192, 448))
    inside_color = base if steel else _inside(rng, base)
    rim_color = inside_color if rng.random() < 0.5 else base
    if rng.random() < 0.12:
        rim_color = colors.against(rng, base)
    lip = np.linspace(0, np.pi, 7)
    top_radius, middle = outer[-1, 0], wall / 2
    rim = np.stack([top_radius - middle + middle * np.cos(lip), height + middle * np.sin(lip)], axis=1)
    recess = rng.uniform(0.015, 0.05)
    parts = [
        revolve(outer, skin, section=section),
        revolve(rim, textures.solid(rim_color), section=section),
        *_underside(rng, outer, section, recess, base, glazed=steel),
    ]
    if rng.random() < form.lid:
        parts += _lid(rng, top_radius, height, base)
    else:
        floor = max(recess + wall * rng.uniform(0.8, 1.6), form.floor * height)
        parts += _hollow(rng, outer, section, wall, floor, inside_color)
    handle_color = base if rng.random() < 0.8 else colors.against(rng, base)
    if rng.random() < 0.15:
        handle_color = inside_color
    loop = (1 - blend) * smooth(loops[0], 36) + blend * smooth(loops[1], 36)
    parts.append(_handle(rng, loop, outer, height, wall, handle_color))
    return join(parts)


def _pairs(rng: np.random.Generator, held_out: bool) -> tuple[Form, Form, list[np.ndarray]]:
    """Two families and two handles to blend, the handles bent a little in training."""
    shapes, handles = (HELD_OUT_SHAPES, HELD_OUT_HANDLES) if held_out else (SHAPES, HANDLES)
    loops = [np.array(handles[str(rng.choice(list(handles)))]) for _ in range(2)]
    if not held_out:
        for loop in loops:
            loop[1:-1] += rng.normal(0, 0.05, (len(loop) - 2, 2))
    first, second = (shapes[str(rng.choice(list(shapes)))] for _ in range(2))
    return first, second, loops


def _outside(rng: np.random.Generator, radii: np.ndarray, height: float, bend: float) -> np.ndarray:
    """Profile (P, 2) of the outside, climbing from the rounded foot to the rim, its radii bent at random by a share."""
    jitter = 1 + rng.normal(0, bend, len(radii))
    curve = smooth(np.stack([radii * jitter, np.linspace(0, height, len(radii))], axis=1), 26)
    curve[:, 0] *= 0.5 / curve[:, 0].max()
    corner = rng.uniform(0.0, 0.12) * height
    lifted = np.clip(1 - curve[:, 1] / max(corner, 1e-6), 0, 1)
    curve[:, 0] -= corner * 0.8 * (1 - np.sqrt(1 - lifted**2))
    return curve


def _underside(
    rng: np.random.Generator, outer: np.ndarray, section: np.ndarray, recess: float, base: np.ndarray, glazed: bool
) -> list[Mesh]:
    """A foot's ring, mostly bare clay, around a glazed floor that often bears a mark."""
    bare = base * 0.95
    if not glazed and rng.random() < 0.65:
        bare = colors.hue(rng, float(rng.uniform(0.05, 0.12)), (0.05, 0.35), (0.55, 0.9))
    width = rng.uniform(0.06, 0.2)
    return undersides.standing_ring(
        rng, outer[0, 0], outer[0, 1], recess, (bare, base * 0.95), section, width, mark=0.6
    )


def _hollow(
    rng: np.random.Generator, outer: np.ndarray, section: np.ndarray, wall: float, floor: float, color: np.ndarray
) -> list[Mesh]:
    """The inside: a wall that follows the outside and a floor with a rounded edge, or a drink."""
    top = float(outer[-1, 1])
    level = top - (top - floor) * rng.uniform(0.06, 0.45)
    filled = rng.random() < 0.4
    levels = np.linspace(top, level if filled else floor, 22)
    radius = np.interp(levels, outer[:, 1], outer[:, 0]) - wall
    tile = textures.solid(color)
    if filled:
        drink = contents.drink(rng, float(radius[-1]), level, section)
        return [revolve(np.stack([radius, levels], axis=1), tile, section=section), *drink]
    bend = rng.uniform(0.05, 0.25) * radius.min()
    lifted = np.clip(1 - (levels - floor) / bend, 0, 1)
    radius = radius - bend * (1 - np.sqrt(1 - lifted**2))
    disc = np.stack([np.linspace(radius[-1], 0, 7), np.full(7, floor)], axis=1)
    return [revolve(np.stack([radius, levels], axis=1), tile, section=section), revolve(disc, tile, section=section)]


def _lid(rng: np.random.Generator, radius: float, height: float, base: np.ndarray) -> list[Mesh]:
    """A plastic lid with a raised rim and a slot to drink from."""
    color = colors.black(rng) if rng.random() < 0.6 else base * 0.9 if rng.random() < 0.5 else colors.any_color(rng)
    tile, wide, tall = textures.solid(color), radius * rng.uniform(0.9, 0.99), rng.uniform(0.06, 0.14)
    inner, sunk = wide * rng.uniform(0.7, 0.88), rng.uniform(0.2, 0.6) * tall
    side = np.array([(radius, height), (wide, height + tall * 0.4), (wide * 0.95, height + tall)])
    brim = np.array([(wide * 0.95, height + tall), (inner, height + tall)])
    well = np.array([(inner, height + tall), (inner * 0.96, height + tall - sunk)])
    slot = plate(circle(16) * [0.12, 0.05], 0.004, textures.solid(color * 0.3), num_rings=2)
    where = shift(0, height + tall - sunk, inner * 0.7)
    return [
        *(revolve(profile, tile, AROUND) for profile in (side, brim, well)),
        plate(circle(AROUND) * inner * 0.96, height + tall - sunk, tile),
        slot.transformed(where),
    ]


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
    reach = rng.uniform(0.28, 0.46) * (0.8 if height > 1.2 else 1.0)
    path_y = low + (high - low) * shape[:, 1]
    foot, top = (np.interp(y, outer[:, 1], outer[:, 0]) - wall / 2 for y in (low, high))
    path_x = foot + (top - foot) * np.clip(shape[:, 1], 0, 1) + (reach + wall / 2) * shape[:, 0]
    path = np.stack([path_x, path_y, np.zeros(len(shape))], axis=1)
    thick, wide = rng.uniform(0.03, 0.065), rng.uniform(0.04, 0.1)
    swell = 1 + rng.uniform(0, 0.35) * np.abs(np.linspace(-1, 1, 36)) ** 4
    if shape[0, 0] > 0.1:  # an end that hangs free is rounded off
        swell = swell * np.sqrt(np.clip(np.linspace(0, 12, 36), 0, 1))
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
