"""Colours of everyday things, drawn at random: RGB in [0, 1]."""

from __future__ import annotations

import colorsys

import numpy as np


def white(rng: np.random.Generator) -> np.ndarray:
    """White, cream or a very light grey."""
    return np.clip(
        rng.uniform(0.86, 0.98) + rng.normal(0, 0.012, 3) + rng.uniform(0, 0.05) * np.array([0, -0.3, -1]), 0, 1
    )


def black(rng: np.random.Generator) -> np.ndarray:
    """Black or a very dark grey."""
    return np.clip(rng.uniform(0.05, 0.24) + rng.normal(0, 0.01, 3), 0, 1)


def grey(rng: np.random.Generator) -> np.ndarray:
    """A neutral grey, now and then a little warm or cold."""
    return np.clip(rng.uniform(0.2, 0.8) + rng.normal(0, 0.015) * np.array([1, 0, -1]), 0, 1)


def metal(rng: np.random.Generator) -> np.ndarray:
    """Aluminium, steel, gold or copper."""
    if rng.random() < 0.8:
        return np.clip(rng.uniform(0.55, 0.85) + rng.normal(0, 0.01, 3), 0, 1)
    return hue(rng, float(rng.uniform(0.05, 0.13)), (0.3, 0.6), (0.6, 0.85))


def hue(
    rng: np.random.Generator,
    value: float | None = None,
    saturation: tuple[float, float] = (0.3, 1.0),
    brightness: tuple[float, float] = (0.25, 0.95),
) -> np.ndarray:
    """A colour proper, of a given or any hue in [0, 1]."""
    value = float(rng.random()) if value is None else value
    return np.array(colorsys.hsv_to_rgb(value % 1, rng.uniform(*saturation), rng.uniform(*brightness)))


def pastel(rng: np.random.Generator) -> np.ndarray:
    """A light, pale colour."""
    return hue(rng, None, (0.08, 0.35), (0.8, 0.97))


def earth(rng: np.random.Generator) -> np.ndarray:
    """Brown, beige, terracotta or olive, as stoneware is glazed."""
    return hue(rng, float(rng.uniform(0.02, 0.17)), (0.2, 0.65), (0.25, 0.8))


def any_color(rng: np.random.Generator, whites: float = 0.3) -> np.ndarray:
    """A colour of an everyday thing, white with probability ``whites``."""
    if rng.random() < whites:
        return white(rng)
    kinds = (hue, hue, hue, pastel, earth, black, grey)
    return kinds[rng.integers(len(kinds))](rng)


def against(rng: np.random.Generator, base: np.ndarray, contrast: float = 0.3) -> np.ndarray:
    """A colour that stands out from another: some channel differs by at least ``contrast``."""
    for _ in range(20):
        color = any_color(rng)
        if np.abs(color - base).max() >= contrast:
            return color
    return white(rng) if base.mean() < 0.5 else black(rng)
