"""Parts of cameras, built with the front at +z: skins, the lens, dials, and what is on the front."""

from __future__ import annotations

import itertools

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.placing import shift, turn_x
from kfit.data.shapes.primitives import circle, plate, revolve, rounded_rectangle
from kfit.data.shapes.textures import as_texture


def plain_skin(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Paint or brushed metal."""
    return textures.solid(base)


def leather_skin(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A leather band between a top and a bottom of metal or paint."""
    leather = colors.black(rng) if rng.random() < 0.65 else colors.earth(rng)
    picture = np.broadcast_to(base, (*size, 3)).copy()
    top, bottom = int(size[0] * rng.uniform(0.15, 0.35)), int(size[0] * rng.uniform(0.85, 0.98))
    grain = textures.speckle(rng, leather, (bottom - top, size[1]))
    picture[top:bottom] = grain / 255.0
    return as_texture(picture)


def banded_skin(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One or two level bands of other shades."""
    picture = np.broadcast_to(base, (*size, 3)).copy()
    for _ in range(rng.integers(1, 3)):
        start = int(size[0] * rng.uniform(0, 0.9))
        picture[start : start + int(size[0] * rng.uniform(0.03, 0.3))] = colors.against(rng, base, 0.15)
    return as_texture(picture)


def panel(size: tuple[float, float], texture: np.ndarray) -> Mesh:
    """An upright plate of the given width and height about the origin that faces +z."""
    return plate(rounded_rectangle(size[0], size[1], min(size) * 0.15), 0.0, texture, num_rings=2).transformed(
        turn_x(np.pi / 2)
    )


def lens(rng: np.random.Generator, radius: float, length: float, trim: np.ndarray) -> list[Mesh]:
    """A barrel of one to three rings along +z from the origin, and a recessed dark glass."""
    barrel = colors.black(rng) if rng.random() < 0.7 else trim
    edges = np.linspace(0, length, int(rng.integers(2, 5)) if length > 0.12 else 2)
    reach = radius * rng.uniform(0.82, 1.0)
    parts = []
    for start, stop in itertools.pairwise(edges):
        if length > 0.12 and rng.random() < 0.5:
            skin = as_texture(_ribs(rng, barrel))
        else:
            skin = textures.solid(barrel if rng.random() < 0.75 else trim)
        parts.append(revolve(np.stack([np.full(5, reach), np.linspace(start, stop, 5)], axis=1), skin, 40))
        next_radius = radius * rng.uniform(0.78, 1.0)
        step = np.array([(reach, stop), ((reach + next_radius) / 2, stop + 1e-3), (next_radius, stop + 2e-3)])
        parts.append(
            revolve(
                step if stop < edges[-1] else step[:1].repeat(2, 0) - [[0, 1e-3], [0, 0]], textures.solid(barrel), 40
            )
        )
        last, reach = reach, next_radius
    rim, glass, depth = last * rng.uniform(0.8, 0.92), last * rng.uniform(0.5, 0.75), min(0.06, length * 0.5)
    ring = textures.solid(barrel if rng.random() < 0.6 else trim)
    bell = np.stack([np.linspace(rim, glass, 6), np.linspace(length, length - depth, 6)], axis=1)
    bulge = np.linspace(1, 0, 8)
    dome = np.stack([glass * bulge, length - depth + 0.35 * depth * (1 - bulge**2)], axis=1)
    if rng.random() < 0.14:
        return [part.transformed(turn_x(np.pi / 2)) for part in [*parts, *_cap(rng, last, length)]]
    parts.append(revolve(np.array([(last, length), ((last + rim) / 2, length + 4e-3), (rim, length)]), ring, 40))
    parts.append(revolve(bell, textures.solid(colors.black(rng)), 40))
    parts.append(revolve(dome, _glass(rng), 40))
    return [part.transformed(turn_x(np.pi / 2)) for part in parts]


def _cap(rng: np.random.Generator, radius: float, at: float) -> list[Mesh]:
    """A lens cap with a name and two grips."""
    color = colors.black(rng) + 0.04
    wide, tile = radius * rng.uniform(1.0, 1.04), textures.solid(color)
    picture = np.ascontiguousarray(np.broadcast_to(as_texture(color), (64, 64, 3)))
    prints.write(rng, picture, (26, 12, 12, 40), colors.white(rng))
    for column in (3, 53):
        picture[18:46, column : column + 8] = as_texture(color * 0.5)
    side = np.array([(wide, at - 0.02), (wide, at + 0.02), (wide * 0.96, at + 0.03)])
    return [revolve(side, tile, 40), plate(circle(40) * wide * 0.96, at + 0.03, picture, num_rings=3)]


def _ribs(rng: np.random.Generator, color: np.ndarray) -> np.ndarray:
    """A ribbed rubber ring, sometimes with a coloured line."""
    wave = 0.75 + 0.5 * (np.arange(256) // 4 % 2)
    picture = np.broadcast_to(color * wave[None, :, None], (16, 256, 3)).copy()
    if rng.random() < 0.3:
        picture[:3] = colors.hue(rng, None, (0.7, 1.0), (0.5, 0.9))
    return picture


def _glass(rng: np.random.Generator) -> np.ndarray:
    """Dark coated glass: rings of violet, green or amber around a black pupil, and a bright reflection."""
    tint = colors.hue(rng, None, (0.3, 0.8), (0.12, 0.4))
    rows = np.linspace(0, 1, 24)[:, None, None]
    picture = np.broadcast_to(tint * rows**2 + 0.03 + 0.06 * np.sin(rows * 9) ** 2, (24, 64, 3)).copy()
    start = rng.integers(0, 50)
    picture[8:15, start : start + 10] += rng.uniform(0.2, 0.6)
    return as_texture(picture)


def _knob(radius: float, tall: float, x: float, y: float, z: float, texture: np.ndarray) -> list[Mesh]:
    side = revolve(np.array([(radius, 0.0), (radius, tall / 2), (radius * 0.96, tall)]), texture, 20)
    top = plate(circle(20) * radius * 0.96, tall, texture, num_rings=2)
    return [part.transformed(shift(x, y, z)) for part in (side, top)]


def controls(rng: np.random.Generator, height: float, depth: float, color: np.ndarray) -> list[Mesh]:
    """The release at the right hand and up to three dials on the top."""
    tile = textures.solid(color)
    ribbed = as_texture(_ribs(rng, color))
    parts = _knob(rng.uniform(0.02, 0.035), 0.02, rng.uniform(-0.42, -0.3), height - 0.002, depth * 0.15, tile)
    for place in rng.permutation([-0.4, -0.24, 0.26, 0.4])[: rng.integers(0, 4)]:
        tall = rng.uniform(0.015, 0.05)
        parts += _knob(
            rng.uniform(0.03, min(0.065, depth * 0.35)), tall, float(place), height - 0.002, -depth * 0.1, ribbed
        )
    return parts


def front(rng: np.random.Generator, height: float, depth: float, lens_edge: float, base: np.ndarray) -> list[Mesh]:
    """A maker's name, a flash and a viewfinder window on the front, where they happen to be."""
    parts = []
    z = depth / 2 + 0.004
    if rng.random() < 0.5:
        name = prints.nameplate(rng, base, (24, 96))
        parts.append(panel((0.2, 0.05), name).transformed(shift(rng.choice([-0.22, 0.3]), height * 0.88, z)))
    if rng.random() < 0.5:
        bright = textures.solid(colors.white(rng))
        parts.append(panel((0.1, 0.05), bright).transformed(shift(0.33, height * rng.uniform(0.78, 0.88), z)))
    if rng.random() < 0.4:
        dark = textures.solid(colors.black(rng) + 0.08)
        parts.append(panel((0.07, 0.045), dark).transformed(shift(rng.uniform(-0.1, 0.2), height * 0.88, z)))
    if lens_edge < 0.36 and rng.random() < 0.3:
        lamp = textures.solid(colors.hue(rng, float(rng.uniform(-0.02, 0.12)), (0.5, 1.0), (0.4, 0.9)))
        parts.append(panel((0.03, 0.03), lamp).transformed(shift(0.42, height * 0.6, z)))
    return parts
