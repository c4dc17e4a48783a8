"""What closes a bottle: screw caps, flip caps, corks, crown caps, spouts, nozzles and carrying loops, or nothing."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import bottle_sprays, colors, textures
from kfit.data.shapes.primitives import revolve, smooth, tube


def build(rng: np.random.Generator, kind: str, neck: float, height: float, body: np.ndarray) -> list[Mesh]:
    """Parts of a top on a round neck.

    Args:
        rng: Source of randomness.
        kind: screw, flip, wide, loop, cork, crown, spout, nozzle, pull or open, or one of ``bottle_sprays``.
        neck: Radius of the neck.
        height: Where the neck ends.
        body: The bottle's colour.
    """
    color = body if rng.random() < 0.15 else colors.any_color(rng, whites=0.45)
    tile = textures.solid(color)
    if kind == "cork":
        lip = _around([(neck, 0), (neck * 1.15, 0.01), (neck * 1.15, 0.09), (neck, 0.1)], height, textures.solid(body))
        foil = height * rng.uniform(0.1, 0.2)
        sleeve = _around([(neck * 1.06, -foil), (neck * 1.06, 0.0)], height, tile)
        stopper = rng.uniform(0.0, 0.12)
        top = _around([(neck * 0.85, 0.1), (neck * 0.85, 0.1 + stopper)], height, textures.solid(colors.earth(rng)))
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
            _around([(wide, 0.0), (wide * 0.98, 0.05), (wide * 0.85, 0.1)], height, tile),
            _lid(wide * 0.85, height + 0.1, tile),
        ]
    if kind in bottle_sprays.KINDS:
        return bottle_sprays.build(rng, kind, neck, height, color)
    if kind == "open":
        return _mouth(neck, height, body)
    if kind in ("spout", "nozzle", "pull"):
        return _spout(rng, neck, height, color, kind)
    tall = {"screw": (0.14, 0.3), "flip": (0.2, 0.45), "wide": (0.25, 0.6), "loop": (0.2, 0.4)}[kind]
    high = float(rng.uniform(*tall))
    wide = neck * (
        rng.uniform(1.05, 1.25)
        if kind == "screw"
        else rng.uniform(1.0, 1.1)
        if kind in ("wide", "loop")
        else rng.uniform(1.2, 1.6)
    )
    taper = rng.uniform(0.88, 1.0)
    if rng.random() < 0.3:
        tile = textures.stripes(rng, color, (16, 128)) if kind == "screw" else textures.two_tone(rng, color, (64, 64))
    edge = 0.02
    side = [(wide, 0.0), (wide * (1 + taper) / 2, high / 2), (wide * taper, high - edge)]
    bevel = [(wide * taper, high - edge), (wide * taper - edge * 0.3, high - edge * 0.3), (wide * taper - edge, high)]
    plain = textures.solid(color)
    loop = []
    if kind == "loop":
        reach, rise = wide * rng.uniform(0.5, 0.9), rng.uniform(0.2, 0.4)
        points = [(-reach, 0.0), (-reach, rise * 0.7), (0.0, rise), (reach, rise * 0.7), (reach, 0.0)]
        path = smooth(np.array([(x, height + high - 0.03 + y, 0.0) for x, y in points]), 22)
        loop = [tube(path, [0.04, rng.uniform(0.05, 0.12)], plain, 10)]
    return [
        *loop,
        _around(side, height, tile),
        _around(bevel, height, plain),
        _lid(wide * taper - edge, height + high, plain),
        revolve(np.array([(neck * 0.5, height), (wide, height)]), plain, 40),
    ]


def _around(points: list[tuple[float, float]], height: float, texture: np.ndarray) -> Mesh:
    """A surface of revolution whose heights count from the neck's end."""
    return revolve(np.array(points) + np.array([0, height]), texture, 40)


def _lid(radius: float, at: float, texture: np.ndarray) -> Mesh:
    """A disc that faces up."""
    return revolve(np.stack([np.linspace(radius, 0, 5), np.full(5, at)], axis=1), texture, 40)


def _mouth(neck: float, height: float, color: np.ndarray) -> list[Mesh]:
    """An open mouth: a lip, and a dark inside."""
    tile, dark = textures.solid(color), textures.solid(color * 0.25)
    lip = [(neck, -0.12), (neck * 1.15, -0.1), (neck * 1.15, -0.02), (neck, 0.0)]
    inner = neck * 0.8
    inside = np.array([(inner, height), (inner, height - 0.2), (inner, height - 0.45)])
    return [
        _around(lip, height, tile),
        revolve(np.array([(neck, height), (inner, height)]), tile, 40),
        revolve(inside, dark, 40),
        _lid(inner, height - 0.45, dark),
    ]


def _spout(rng: np.random.Generator, neck: float, height: float, color: np.ndarray, kind: str) -> list[Mesh]:
    """A sports bottle's lid with its mouthpiece, a sauce bottle's pointed nozzle, or a cap that is pulled open."""
    tile = textures.solid(color)
    other = textures.solid(colors.any_color(rng) if rng.random() < 0.6 else color)
    collar = neck * rng.uniform(1.0, 1.15)
    low = rng.uniform(0.1, 0.25)
    if kind == "pull":
        tip, rise = neck * rng.uniform(0.4, 0.55), rng.uniform(0.16, 0.26)
        controls = [(collar * 0.9, low), (tip * 0.7, low + rise * 0.3), (tip, low + rise * 0.6), (tip, low + rise)]
        cone = smooth(np.array(controls), 14)
    elif kind == "nozzle":
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
        _around([(collar, -0.02), (collar, low / 2), (collar * 0.95, low)], height, tile),
        _around([(collar * 0.95, low), (collar * 0.9, low + 0.001)], height, tile),
        _around([(float(r), float(y)) for r, y in cone], height, other),
        _lid(float(cone[-1, 0]), height + float(cone[-1, 1]), other),
    ]
