"""What closes a bottle: screw caps, flip caps, corks, crown caps, pumps, spouts and nozzles."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, textures
from kfit.data.shapes.primitives import revolve, smooth, tube


def build(rng: np.random.Generator, kind: str, neck: float, height: float, body: np.ndarray) -> list[Mesh]:
    """Parts of a top on a round neck.

    Args:
        rng: Source of randomness.
        kind: screw, flip, wide, cork, crown, pump, spout or nozzle.
        neck: Radius of the neck.
        height: Where the neck ends.
        body: The bottle's colour.
    """
    color = body if rng.random() < 0.15 else colors.any_color(rng, whites=0.45)
    tile = textures.solid(color)
    if kind == "cork":
        lip = _turned([(neck, 0), (neck * 1.15, 0.01), (neck * 1.15, 0.09), (neck, 0.1)], height, textures.solid(body))
        foil = height * rng.uniform(0.1, 0.2)
        sleeve = _turned([(neck * 1.06, -foil), (neck * 1.06, 0.0)], height, tile)
        stopper = rng.uniform(0.0, 0.12)
        top = _turned([(neck * 0.85, 0.1), (neck * 0.85, 0.1 + stopper)], height, textures.solid(colors.earth(rng)))
        return [
            lip,
            sleeve,
            top,
            _lid(neck * 1.15, height + 0.1, tile),
            _lid(neck * 0.85, height + 0.1 + stopper, tile),
        ]
    if kind == "crown":
        wide = neck * rng.uniform(1.12, 1.25)
        return [
            _turned([(wide, 0.0), (wide * 0.98, 0.05), (wide * 0.85, 0.1)], height, tile),
            _lid(wide * 0.85, height + 0.1, tile),
        ]
    if kind == "pump":
        return _pump(rng, neck, height, color)
    if kind in ("spout", "nozzle"):
        return _spout(rng, neck, height, color, kind == "nozzle")
    tall = {"screw": (0.14, 0.3), "flip": (0.2, 0.45), "wide": (0.25, 0.6)}[kind]
    high = float(rng.uniform(*tall))
    wide = neck * (
        rng.uniform(1.05, 1.25)
        if kind == "screw"
        else rng.uniform(1.0, 1.1)
        if kind == "wide"
        else rng.uniform(1.2, 1.6)
    )
    taper = rng.uniform(0.88, 1.0)
    if rng.random() < 0.3:
        tile = textures.stripes(rng, color, (16, 128)) if kind != "wide" else textures.two_tone(rng, color, (64, 64))
    edge = 0.02
    side = [(wide, 0.0), (wide * (1 + taper) / 2, high / 2), (wide * taper, high - edge)]
    bevel = [(wide * taper, high - edge), (wide * taper - edge * 0.3, high - edge * 0.3), (wide * taper - edge, high)]
    plain = textures.solid(color)
    return [
        _turned(side, height, tile),
        _turned(bevel, height, plain),
        _lid(wide * taper - edge, height + high, plain),
        revolve(np.array([(neck * 0.5, height), (wide, height)]), plain, 40),
    ]


def _turned(points: list[tuple[float, float]], height: float, texture: np.ndarray) -> Mesh:
    """A surface of revolution whose heights count from the neck's end."""
    return revolve(np.array(points) + np.array([0, height]), texture, 40)


def _lid(radius: float, at: float, texture: np.ndarray) -> Mesh:
    """A disc that faces up."""
    return revolve(np.stack([np.linspace(radius, 0, 5), np.full(5, at)], axis=1), texture, 40)


def _pump(rng: np.random.Generator, neck: float, height: float, color: np.ndarray) -> list[Mesh]:
    """A collar, a stem and a head with a spout that points to +x."""
    tile = textures.solid(color)
    collar, stem, head = neck * rng.uniform(1.1, 1.4), neck * rng.uniform(0.25, 0.45), neck * rng.uniform(0.6, 1.0)
    low, rise, tall = rng.uniform(0.1, 0.22), rng.uniform(0.12, 0.4), rng.uniform(0.08, 0.15)
    top = low + rise + tall
    reach = rng.uniform(0.35, 0.7)
    path = smooth(
        np.array(
            [
                (0, height + top - tall / 2, 0),
                (reach * 0.7, height + top - tall / 2, 0),
                (reach, height + top - tall, 0),
            ]
        ),
        14,
    )
    return [
        _turned([(collar, 0), (collar * 0.98, low / 2), (collar * 0.9, low)], height, tile),
        _lid(collar * 0.9, height + low, tile),
        _turned([(stem, low), (stem, low + rise)], height, tile),
        revolve(np.array([(stem, height + low + rise), (head, height + low + rise)]), tile, 32),
        _turned([(head, low + rise), (head, low + rise + tall / 2), (head * 0.9, top)], height, tile),
        _lid(head * 0.9, height + top, tile),
        tube(path, [tall * 0.4, tall * rng.uniform(0.4, 0.9)], tile, 12),
    ]


def _spout(rng: np.random.Generator, neck: float, height: float, color: np.ndarray, pointed: bool) -> list[Mesh]:
    """A sports bottle's lid with its mouthpiece, or a sauce bottle's pointed nozzle."""
    tile = textures.solid(color)
    other = textures.solid(colors.any_color(rng) if rng.random() < 0.6 else color)
    collar = neck * rng.uniform(1.0, 1.15)
    low = rng.uniform(0.1, 0.25)
    if pointed:
        tip, rise = neck * rng.uniform(0.12, 0.3), rng.uniform(0.3, 0.6)
        cone = smooth(np.array([(collar * 0.9, low), (neck * 0.6, low + rise * 0.3), (tip, low + rise)]), 10)
    else:
        tip, rise = neck * rng.uniform(0.25, 0.5), rng.uniform(0.15, 0.35)
        cone = smooth(
            np.array(
                [(collar * 0.95, low), (neck * 0.75, low + rise * 0.35), (tip, low + rise * 0.6), (tip, low + rise)]
            ),
            12,
        )
    return [
        _turned([(collar, -0.02), (collar, low / 2), (collar * 0.95, low)], height, tile),
        _turned([(collar * 0.95, low), (collar * 0.9, low + 0.001)], height, tile),
        _turned([(float(r), float(y)) for r, y in cone], height, other),
        _lid(float(cone[-1, 0]), height + float(cone[-1, 1]), other),
    ]
