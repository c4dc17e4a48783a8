"""Texture families: patterns that cover a surface, as (height, width, 3) uint8 pictures that wrap from left to right.

Each family is a function ``(rng, base, size)`` of a random generator, the base colour in [0, 1] and the picture's
(height, width); a surface of revolution is wrapped once around by the width, and the upper row is its upper edge.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from kfit.data.shapes import colors

Family = Callable[[np.random.Generator, np.ndarray, tuple[int, int]], np.ndarray]


def as_texture(picture: np.ndarray) -> np.ndarray:
    """Clip a float picture in [0, 1] to (H, W, 3) uint8."""
    levels: np.ndarray = np.clip(picture, 0, 1) * 255 + 0.5
    return levels.astype(np.uint8)


def solid(color: np.ndarray) -> np.ndarray:
    """A tile of one colour."""
    return as_texture(np.broadcast_to(np.asarray(color, np.float64), (4, 4, 3)))


def cloud(rng: np.random.Generator, size: tuple[int, int], cells: int = 4, octaves: int = 4) -> np.ndarray:
    """Smooth noise (H, W) in [0, 1] that wraps from left to right."""
    height, width = size
    total: np.ndarray = np.zeros(size)
    for octave in range(octaves):
        rows, columns = cells * 2**octave + 1, cells * 2**octave
        coarse = rng.random((rows, columns)).astype(np.float32)
        coarse = np.concatenate([coarse, coarse[:, :1]], axis=1)
        total += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC) / 2**octave
    total = total - total.min()
    return total / max(float(total.max()), 1e-9)


def _blend(base: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    return as_texture(base + (other - base) * share[..., None])


def plain(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One colour."""
    return solid(base)


def two_tone(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Two colours, one above the other, as if dipped."""
    edge = rng.uniform(0.2, 0.8) + rng.uniform(0, 0.04) * np.sin(
        np.linspace(0, 2 * np.pi, size[1]) * rng.integers(1, 5)
    )
    rows = np.linspace(0, 1, size[0])[:, None]
    return _blend(base, colors.against(rng, base), np.clip((rows - edge) * size[0] / 2, 0, 1))


def rings(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One to six bands around."""
    picture = np.tile(base, (size[0], 1))
    for _ in range(rng.integers(1, 7)):
        start, width = rng.random(), rng.uniform(0.015, 0.12)
        picture[int(start * size[0]) : max(int((start + width) * size[0]), int(start * size[0]) + 2)] = colors.against(
            rng, base
        )
    return as_texture(np.broadcast_to(picture[:, None], (*size, 3)))


def stripes(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Upright or slanted stripes."""
    u, v = np.meshgrid(np.arange(size[1]) / size[1], np.arange(size[0]) / size[1])
    wave = np.sin(2 * np.pi * (rng.integers(4, 16) * u + rng.choice([0, 0, rng.uniform(-10, 10)]) * v))
    return _blend(base, colors.against(rng, base), np.clip((wave - rng.uniform(-0.5, 0.6)) * 6 + 0.5, 0, 1))


def dots(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Polka dots in a staggered grid."""
    across = rng.integers(6, 16)
    u, v = np.meshgrid(np.arange(size[1]) / size[1] * across, np.arange(size[0]) / size[1] * across)
    u = u + 0.5 * (np.floor(v) % 2)
    radius = np.hypot(u % 1 - 0.5, v % 1 - 0.5)
    share = np.clip((rng.uniform(0.2, 0.4) - radius) * 12 + 0.5, 0, 1)
    return _blend(base, colors.against(rng, base), share)


def checks(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A chequerboard or a tartan."""
    across = 2 * rng.integers(3, 9)
    u, v = np.meshgrid(np.arange(size[1]) / size[1] * across, np.arange(size[0]) / size[1] * across)
    first, second = np.floor(u) % 2, np.floor(v) % 2
    share = (first + second) / 2 if rng.random() < 0.5 else np.abs(first - second)
    return _blend(base, colors.against(rng, base), share)


def marble(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Veins."""
    noise = cloud(rng, size, 3)
    veins = np.clip(1 - np.abs(noise - 0.5) * rng.uniform(6, 14), 0, 1)
    return _blend(base, colors.against(rng, base, 0.2), veins)


def speckle(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Stoneware: fine specks over a cloudy glaze."""
    shade = 1 + (cloud(rng, size) - 0.5) * rng.uniform(0.05, 0.4)
    specks = cv2.GaussianBlur((rng.random(size) < 0.02).astype(np.float32), (0, 0), 1.0) * rng.uniform(1, 4)
    return as_texture(base * shade[..., None] * (1 - np.clip(specks, 0, 0.8))[..., None])


def gradient(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A glaze that runs from one colour to another."""
    share = np.linspace(0, 1, size[0])[:, None] + (cloud(rng, size) - 0.5) * rng.uniform(0, 0.4)
    return _blend(base, colors.against(rng, base), np.clip(share, 0, 1) ** rng.uniform(0.5, 2))


def wood(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Wood grain that runs along the width."""
    base = colors.hue(rng, float(rng.uniform(0.05, 0.11)), (0.35, 0.65), (0.35, 0.8))
    noise = cloud(rng, size, 2, 3)
    rows = np.linspace(0, rng.uniform(4, 12), size[0])[:, None]
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * (rows + 1.5 * noise))
    return _blend(base, base * rng.uniform(0.5, 0.8), grain)


def blotches(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Large patches of two further colours, as camouflage or splashed glaze has."""
    picture = np.broadcast_to(base, (*size, 3)).copy()
    for _ in range(2):
        picture[cloud(rng, size, 3) > rng.uniform(0.5, 0.7)] = colors.against(rng, base, 0.2)
    return as_texture(picture)


def zigzag(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Chevron bands."""
    u, v = np.meshgrid(np.arange(size[1]) / size[1], np.arange(size[0]) / size[1])
    tooth = np.abs((u * rng.integers(6, 14)) % 1 - 0.5) * rng.uniform(0.05, 0.15)
    return _blend(base, colors.against(rng, base), ((v + tooth) * rng.uniform(8, 20)).astype(int) % 2)


def mixed(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A pattern of no family: waves of any direction and a cloud, cut into areas of two to four colours."""
    u, v = np.meshgrid(np.arange(size[1]) / size[1], np.arange(size[0]) / size[1])
    field = rng.uniform(0, 4) * cloud(rng, size, 3, 3)
    for _ in range(rng.integers(2, 4)):
        phase = rng.integers(-12, 13) * u + rng.uniform(-12, 12) * v + rng.random()
        field += rng.uniform(0.3, 1) * np.cos(2 * np.pi * phase)
    edges = np.quantile(field, np.sort(rng.uniform(0.15, 0.85, rng.integers(1, 4))))
    palette = np.stack([base, *(colors.against(rng, base) for _ in edges)])
    return as_texture(palette[np.searchsorted(edges, field)])


def choose(rng: np.random.Generator, families: dict[str, tuple[Family, float]]) -> Family:
    """Draw a family at random, by the weights."""
    weights = np.array([weight for _, weight in families.values()])
    return list(families.values())[rng.choice(len(families), p=weights / weights.sum())][0]
