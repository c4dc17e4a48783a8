"""What mugs and bowls hold: drinks as level discs, soups, and heaps of food."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, textures
from kfit.data.shapes.placing import shift
from kfit.data.shapes.primitives import circle, plate, revolve, sheet
from kfit.data.shapes.textures import as_texture

_SIZE = 96


def drink(rng: np.random.Generator, radius: float, at: float, section: np.ndarray | None = None) -> list[Mesh]:
    """Coffee, tea, milk, juice or foam up to a height."""
    outline = circle(32) if section is None else section
    return [plate(outline * radius, at, _surface(rng), num_rings=3)]


def _surface(rng: np.random.Generator) -> np.ndarray:
    """A drink's surface: an even colour that changes to the edge, bubbles, or foam with a figure in it."""
    across = np.linspace(-1, 1, _SIZE)
    distance = np.hypot(*np.meshgrid(across, across))
    kind = rng.random()
    if kind < 0.4:  # coffee
        base, edge = colors.hue(rng, 0.07, (0.5, 0.8), (0.06, 0.25)), colors.hue(rng, 0.08, (0.4, 0.7), (0.3, 0.55))
    elif kind < 0.6:  # coffee with milk, cocoa
        base = colors.hue(rng, float(rng.uniform(0.05, 0.09)), (0.3, 0.55), (0.4, 0.75))
        edge = base * rng.uniform(1.0, 1.25)
    elif kind < 0.8:  # tea
        base = colors.hue(rng, float(rng.uniform(0.03, 0.14)), (0.6, 0.95), (0.25, 0.75))
        edge = base * 0.7
    elif kind < 0.9:  # milk or water
        base = colors.white(rng) * rng.uniform(0.75, 1.0)
        edge = base * 0.95
    else:
        base = colors.hue(rng)
        edge = base * rng.uniform(0.8, 1.2)
    share = np.clip((distance - rng.uniform(0.7, 0.9)) / 0.1, 0, 1)[..., None]
    picture = base + (edge - base) * share
    if kind < 0.6 and rng.random() < 0.45:  # foam
        foam = colors.hue(rng, 0.09, (0.05, 0.3), (0.75, 0.97))
        width = rng.uniform(0.35, 0.8)
        angle = np.arctan2(*np.meshgrid(across, across))
        lobes = 1 + rng.uniform(0, 0.5) * np.cos(angle * rng.integers(1, 6) + rng.uniform(0, 6))
        shape = distance / width * lobes + 0.5 * (textures.cloud(rng, (_SIZE, _SIZE), 3) - 0.5)
        picture = picture + (foam - picture) * np.clip((1 - shape) * 6, 0, 1)[..., None]
    return as_texture(picture * (1 + 0.1 * (textures.cloud(rng, (_SIZE, _SIZE), 4)[..., None] - 0.5)))


def food(rng: np.random.Generator, radius: float, at: float, room: float) -> list[Mesh]:
    """A soup, a heap, or pieces, up to a height; a heap rises at most ``room`` above it."""
    kind = rng.random()
    base = _food_color(rng)
    if kind < 0.35:
        picture = textures.speckle(rng, base, (_SIZE, _SIZE)) / 255.0
        for _ in range(rng.integers(0, 3)):
            bits = textures.cloud(rng, (_SIZE, _SIZE), 8, 2) > rng.uniform(0.62, 0.75)
            picture[bits] = _food_color(rng)
        return [plate(circle(40) * radius, at, as_texture(picture), num_rings=3)]
    heap = [_heap(rng, radius, at, room * rng.uniform(0.3, 1.0), base)]
    if kind < 0.7:
        return heap
    return heap + _pieces(rng, radius, at, room)


def _food_color(rng: np.random.Generator) -> np.ndarray:
    """Rice and yoghurt, cereal and pasta, tomato, salad, fruit."""
    low, high = ((0.07, 0.12), (0.09, 0.14), (0.0, 0.07), (0.18, 0.32), (-0.08, 0.17))[rng.integers(5)]
    if rng.random() < 0.25:
        return colors.white(rng)
    return colors.hue(rng, float(rng.uniform(low, high)), (0.35, 0.85), (0.35, 0.85))


def _heap(rng: np.random.Generator, radius: float, at: float, rise: float, base: np.ndarray) -> Mesh:
    """A lumpy mound of grains or leaves."""
    share, angle = np.linspace(1, 0, 16)[:, None], np.linspace(0, 2 * np.pi, 41)[None]
    lumps = textures.cloud(rng, (16, 40), 5, 3)
    lumps = np.concatenate([lumps, lumps[:, :1]], axis=1)
    lumps[-1] = lumps[-1].mean()
    height = rise * ((1 - share**2) * 0.7 + 0.3 * lumps * np.sqrt(np.maximum(1 - share, 0)))
    grains = rng.random((_SIZE, _SIZE)).astype(np.float32)
    grains = 0.55 + 0.9 * np.repeat(np.repeat(grains[::3, ::3], 3, 0), 3, 1)[:_SIZE, :_SIZE]
    picture = base * grains[..., None]
    for _ in range(rng.integers(0, 3)):
        picture[textures.cloud(rng, (_SIZE, _SIZE), 7, 2) > rng.uniform(0.6, 0.75)] = _food_color(rng)
    points = [radius * share * np.sin(angle), at + height, radius * share * np.cos(angle)]
    mound = sheet(np.stack(np.broadcast_arrays(*points), axis=-1), as_texture(picture))
    if rng.random() < 0.3:  # noodles, which lie in rings
        return mound
    return replace(mound, uv=(mound.vertices[:, [0, 2]] / (2 * radius) + 0.5).clip(0, 1).astype(np.float32))


def _pieces(rng: np.random.Generator, radius: float, at: float, room: float) -> list[Mesh]:
    """A few round fruits, eggs or dumplings."""
    arc = np.linspace(-np.pi / 2, np.pi / 2, 8)
    pieces = []
    tile = textures.solid(_food_color(rng))
    for _ in range(rng.integers(1, 6)):
        size = min(radius * rng.uniform(0.15, 0.4), room)
        place, angle = (radius - size) * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        ball = revolve(size * np.stack([np.cos(arc), np.sin(arc) * rng.uniform(0.7, 1.0)], axis=1), tile, 14)
        pieces.append(ball.transformed(shift(place * np.sin(angle), at, place * np.cos(angle))))
    return pieces
