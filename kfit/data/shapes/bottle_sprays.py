"""Tops of bottles that dose: pumps, triggers, fine sprays and droppers, on a neck and towards +x."""

from __future__ import annotations

import itertools

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, textures
from kfit.data.shapes.placing import shift, turn_x, turn_y
from kfit.data.shapes.primitives import circle, extrusion, plate, polygon, revolve, smooth, tube

KINDS = ("pump", "trigger", "mist", "dropper")


def build(rng: np.random.Generator, kind: str, neck: float, height: float, color: np.ndarray) -> list[Mesh]:
    """Parts of one of ``KINDS`` on a round neck that ends at a height."""
    made = {"pump": _pump, "trigger": _trigger, "mist": _mist, "dropper": _dropper}[kind](rng, neck, color)
    return [part.transformed(shift(0, height, 0)) for part in made]


def _stack(steps: list[tuple[float, float]], texture: np.ndarray) -> list[Mesh]:
    """Cylinders and rings through (radius, height) steps from the lowest up, closed above; each corner is a crease."""
    parts = [revolve(np.array([low, high]), texture, 32) for low, high in itertools.pairwise(steps)]
    return [*parts, plate(circle(32) * steps[-1][0], steps[-1][1], texture, num_rings=2)]


def _collar(rng: np.random.Generator, radius: float, tall: float, color: np.ndarray) -> list[Mesh]:
    """A screwed ring, often ribbed."""
    ribs = 0.8 + 0.4 * (np.arange(128) // 2 % 2)
    ribbed = textures.as_texture(np.broadcast_to(color * ribs[None, :, None], (8, 128, 3)))
    tile = ribbed if rng.random() < 0.6 else textures.solid(color)
    return _stack([(radius * 0.6, 0.0), (radius, 0.0), (radius * 0.97, tall)], tile)


def _pump(rng: np.random.Generator, neck: float, color: np.ndarray) -> list[Mesh]:
    """A collar, a stem and a head with a spout."""
    tile = textures.solid(color)
    collar, stem, head = neck * rng.uniform(1.1, 1.4), neck * rng.uniform(0.25, 0.45), neck * rng.uniform(0.6, 1.0)
    low, rise, tall = rng.uniform(0.1, 0.22), rng.uniform(0.12, 0.4), rng.uniform(0.08, 0.15)
    top, reach = low + rise + tall, rng.uniform(0.35, 0.7)
    tip = np.array([(0, top - tall / 2, 0), (reach * 0.7, top - tall / 2, 0), (reach, top - tall, 0)])
    steps = [(stem, low), (stem, low + rise), (head, low + rise), (head, low + rise + tall / 2), (head * 0.9, top)]
    spout = tube(smooth(tip, 14), [tall * 0.4, tall * rng.uniform(0.4, 0.9)], tile, 12)
    nozzle = revolve(
        np.stack([np.linspace(0, 0.3 * tall, 3), np.full(3, reach)], axis=1)[::-1], textures.solid(color * 0.2), 8
    )
    end = nozzle.transformed(shift(0, top - tall, 0) @ turn_y(np.pi / 2) @ turn_x(np.pi / 2))
    return [*_collar(rng, collar, low, color), *_stack(steps, tile), spout, end]


def _trigger(rng: np.random.Generator, neck: float, color: np.ndarray) -> list[Mesh]:
    """A collar, a head that reaches forward with a nozzle at its front, and a lever below it."""
    second = color if rng.random() < 0.3 else colors.any_color(rng, whites=0.4)
    tile, other = textures.solid(color), textures.solid(second)
    low, tall, front, back = (
        rng.uniform(0.12, 0.2),
        rng.uniform(0.3, 0.42),
        rng.uniform(0.4, 0.58),
        rng.uniform(0.25, 0.4),
    )
    thick = rng.uniform(0.2, 0.3)
    crest, dip = low + tall, rng.uniform(0.0, 0.08)
    corners = [
        (-0.1, crest),
        (front * 0.55, crest - dip * 0.5),
        (front * 0.75, crest - 0.04 - dip),
        (front * 0.75, crest - 0.17 - dip),
        (0.14, low + tall * 0.42),
        (0.13, low - 0.02),
        (-0.13, low - 0.02),
        (-back * 0.75, low + tall * 0.5),
        (-back, crest - 0.1),
    ]
    head = extrusion(polygon(corners, 4), thick, thick * rng.uniform(0.1, 0.3), tile)
    radius, middle = rng.uniform(0.055, 0.08), crest - 0.105 - dip
    tip = [(radius * 0.9, front * 0.74), (radius, front * 0.78), (radius * 0.9, front)]
    nozzle = [
        part.transformed(shift(0, middle, 0) @ turn_y(np.pi / 2) @ turn_x(np.pi / 2)) for part in _stack(tip, other)
    ]
    pull = rng.uniform(0.0, 0.08)
    points = [(front * 0.55, crest - 0.15), (front * 0.5 - pull, low + tall * 0.3), (front * 0.62 - pull, low - 0.1)]
    path = smooth(np.array([(x, y, 0.0) for x, y in points]), 14)
    width = np.linspace(0.1, 0.07, 14)
    lever = tube(path, np.stack([np.linspace(0.035, 0.02, 14), width], axis=1), other, 10)
    return [*_collar(rng, max(neck * 1.12, 0.17), low, second), *head, *nozzle, lever]


def _mist(rng: np.random.Generator, neck: float, color: np.ndarray) -> list[Mesh]:
    """A collar and a small button that is pressed down, sometimes under a clear cap."""
    collar, button = neck * rng.uniform(1.05, 1.3), neck * rng.uniform(0.5, 0.8)
    low, tall = rng.uniform(0.1, 0.25), rng.uniform(0.18, 0.3)
    tile = textures.solid(color)
    steps = [(button * 0.6, low), (button * 0.6, low + 0.05), (button, low + 0.05), (button * 0.95, low + tall)]
    outlet = plate(circle(12) * button * 0.25, button * 1.0, textures.solid(color * 0.3), num_rings=2)
    outlet = outlet.transformed(shift(0, low + 0.05 + tall * 0.4, 0) @ turn_y(np.pi / 2) @ turn_x(np.pi / 2))
    return [*_collar(rng, collar, low, color), *_stack(steps, tile), outlet]


def _dropper(rng: np.random.Generator, neck: float, color: np.ndarray) -> list[Mesh]:
    """A collar with a rubber bulb to squeeze."""
    collar, tall = neck * rng.uniform(1.1, 1.3), rng.uniform(0.2, 0.35)
    bulb, rise = neck * rng.uniform(0.6, 0.8), rng.uniform(0.35, 0.6)
    rubber = textures.solid(colors.black(rng) if rng.random() < 0.6 else colors.any_color(rng, whites=0.5))
    controls = [
        (bulb * 0.8, tall),
        (bulb * 0.75, tall + 0.06),
        (bulb, tall + rise * 0.55),
        (bulb * 0.7, tall + rise * 0.95),
    ]
    curve = smooth(np.array([*controls, (0.0, tall + rise)]), 16)
    return [*_collar(rng, collar, tall, color), revolve(curve, rubber, 28)]
