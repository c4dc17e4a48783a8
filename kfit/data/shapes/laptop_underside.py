"""What a laptop shows from below and at its sides: rubber feet, vents, screws, stickers and sockets."""

from __future__ import annotations

import cv2
import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.placing import shift, turn_x, turn_y
from kfit.data.shapes.primitives import circle, plate, rounded_rectangle, slab
from kfit.data.shapes.textures import as_texture

_WIDTH = 160


def face(rng: np.random.Generator, color: np.ndarray, depth: float) -> np.ndarray:
    """The underside's print, seen from below: vents, seams, screws and a sticker."""
    height = int(_WIDTH * depth)
    picture = np.ascontiguousarray(np.broadcast_to(as_texture(color), (height, _WIDTH, 3)))
    dark = tuple(int(255 * c) for c in np.clip(color * 0.35, 0, 1))
    line = tuple(int(255 * c) for c in np.clip(color * 0.7 + 0.02, 0, 1))
    for _ in range(rng.integers(1, 4)):
        tall, wide = int(height * rng.uniform(0.06, 0.16)), int(_WIDTH * rng.uniform(0.15, 0.6))
        row, column = int(height * rng.uniform(0.06, 0.45)), int((_WIDTH - wide) * rng.uniform(0.1, 0.9))
        step = int(rng.integers(3, 6))
        for place in range(0, wide, step):
            cv2.line(picture, (column + place, row), (column + place, row + tall), dark, max(1, step // 2))
    if rng.random() < 0.5:  # a battery or a cover
        top = int(height * rng.uniform(0.5, 0.65))
        cv2.rectangle(picture, (int(_WIDTH * 0.12), top), (int(_WIDTH * 0.88), int(height * 0.9)), line, 1)
    for x in (0.05, 0.5, 0.95):
        for y in (0.06, 0.94):
            cv2.circle(picture, (int(_WIDTH * x), int(height * y)), 2, dark, -1, cv2.LINE_AA)
    for _ in range(rng.integers(0, 3)):
        tall, wide = int(height * rng.uniform(0.1, 0.2)), int(_WIDTH * rng.uniform(0.12, 0.25))
        row, column = int(height * rng.uniform(0.3, 0.7)), int(_WIDTH * rng.uniform(0.1, 0.7))
        ground = colors.white(rng) if rng.random() < 0.6 else colors.any_color(rng)
        picture[row : row + tall, column : column + wide] = as_texture(ground)
        prints.lines(rng, picture, (row + 2, column + 2, tall - 3, wide - 4), colors.against(rng, ground, 0.4))
    return picture


def feet(rng: np.random.Generator, depth: float) -> list[Mesh]:
    """Four round feet, or a strip at the front and one at the back."""
    rubber = textures.solid(colors.black(rng) if rng.random() < 0.8 else colors.grey(rng))
    tall, z = rng.uniform(0.006, 0.014), depth / 2 - rng.uniform(0.05, 0.09)
    skins = (rubber, rubber, rubber)
    if rng.random() < 0.55:
        pad = slab(circle(14) * rng.uniform(0.018, 0.032), -tall, 0.002, tall / 3, skins)
        places = [(x, side * z) for x in (-0.42, 0.42) for side in (-1, 1)]
    else:
        strip = rounded_rectangle(rng.uniform(0.5, 0.8), rng.uniform(0.02, 0.035), 0.01, 3, 2)
        pad, places = slab(strip, -tall, 0.002, tall / 3, skins), [(0.0, -z), (0.0, z)]
    return [part.transformed(shift(x, 0, at)) for x, at in places for part in pad[1:]]


def sockets(rng: np.random.Generator, height: float, depth: float) -> list[Mesh]:
    """Dark sockets along both sides, and on some a vent at the back."""
    dark = textures.solid(np.full(3, rng.uniform(0.02, 0.1)))
    tall = height * 0.35
    parts = []
    for side in (-1, 1):
        for place in np.arange(-0.38, 0.3, 0.11)[: rng.integers(1, 6)]:
            outline = rounded_rectangle(rng.uniform(0.02, 0.06), tall, tall * 0.3, 3, 1)
            hole = plate(outline, 0.0, dark, num_rings=2).transformed(turn_x(np.pi / 2))
            at = shift(side * 0.501, height * 0.5, place * depth) @ turn_y(side * np.pi / 2)
            parts.append(hole.transformed(at))
    if rng.random() < 0.4:
        slots = as_texture(np.tile(np.where(np.arange(64) % 4 < 2, 0.05, 0.3)[None, :, None], (4, 1, 3)))
        vent = plate(rounded_rectangle(rng.uniform(0.3, 0.7), tall, tall * 0.2, 3, 1), 0.0, slots, num_rings=2)
        parts.append(vent.transformed(shift(0, height * 0.5, -depth / 2 - 0.001) @ turn_y(np.pi) @ turn_x(np.pi / 2)))
    return parts
