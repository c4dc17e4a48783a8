"""Things printed on a surface: text, labels, logos, photographs and what screens show, as (H, W, 3) uint8 pictures.

Each takes a random generator, the colour it is printed on and the picture's (height, width), as texture families do.
"""

from __future__ import annotations

import cv2
import numpy as np

from kfit.data.shapes import colors
from kfit.data.shapes.textures import as_texture, cloud

_FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_SCRIPT_COMPLEX)
_LETTERS = np.array(list("AAABCDEEEFGHIIKLMNOOPRSSTTUVWYaabcdeefghiiklmnoprstu0123456789"))


def _rgb(color: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (round(float(c) * 255) for c in color)
    return red, green, blue


def _canvas(base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(as_texture(base), (*size, 3)))


def write(rng: np.random.Generator, picture: np.ndarray, box: tuple[int, int, int, int], color: np.ndarray) -> None:
    """Write a random word into a box (row, column, height, width) of a uint8 picture, in place."""
    row, column, height, width = box
    font = int(rng.choice(_FONTS))
    word = "".join(rng.choice(_LETTERS, rng.integers(2, 9)))
    (wide, tall), _ = cv2.getTextSize(word, font, 1.0, 1)
    scale = min(width / max(wide, 1), height / max(tall, 1) * 0.9)
    thickness = max(1, round(scale * rng.uniform(1, 4)))
    cv2.putText(picture, word, (column, row + int(height * 0.9)), font, scale, _rgb(color), thickness, cv2.LINE_AA)


def lines(rng: np.random.Generator, picture: np.ndarray, box: tuple[int, int, int, int], color: np.ndarray) -> None:
    """Fill a box (row, column, height, width) with strokes like lines of small text, in place."""
    row, column, height, width = box
    pitch = max(3, int(rng.integers(3, 8)))
    for y in range(row, row + height - 1, pitch):
        x = column
        stop = column + int(width * rng.uniform(0.5, 1))
        while x < stop:
            length = int(rng.integers(3, 14))
            cv2.line(picture, (x, y), (min(x + length, stop), y), _rgb(color), max(1, pitch // 3), cv2.LINE_AA)
            x += length + 3


def figure(rng: np.random.Generator, picture: np.ndarray, box: tuple[int, int, int, int], base: np.ndarray) -> None:
    """Draw a few simple shapes like a logo's into a box (row, column, height, width), in place."""
    row, column, height, width = box
    half = min(height, width) / 2
    for _ in range(rng.integers(1, 5)):
        color = _rgb(colors.against(rng, base, 0.25))
        centre = (
            int(column + width / 2 + rng.normal(0, width / 8)),
            int(row + height / 2 + rng.normal(0, height / 8)),
        )
        radius = max(2, int(half * rng.uniform(0.2, 0.9)))
        kind = rng.integers(4)
        fill = -1 if rng.random() < 0.7 else max(1, radius // 5)
        if kind == 0:
            cv2.circle(picture, centre, radius, color, fill, cv2.LINE_AA)
        elif kind == 1:
            axes = (radius, max(2, int(radius * rng.uniform(0.3, 0.9))))
            cv2.ellipse(picture, centre, axes, float(rng.uniform(0, 180)), 0, 360, color, fill, cv2.LINE_AA)
        else:
            corners = rng.integers(3, 8)
            angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
            points = np.stack([np.cos(angle), np.sin(angle)], 1) * radius * rng.uniform(0.5, 1, (corners, 1)) + centre
            cv2.fillPoly(picture, [points.astype(np.int32)], color, cv2.LINE_AA)


def photo(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Something like a photo: a sky, a ground and soft blobs of many colours."""
    height, width = size
    rows = np.linspace(0, 1, height)[:, None, None]
    top, bottom = colors.any_color(rng), colors.any_color(rng)
    picture = top + (bottom - top) * np.clip((rows - rng.uniform(0.2, 0.7)) * rng.uniform(1, 20) + 0.5, 0, 1)
    picture = np.broadcast_to(picture, (height, width, 3)).copy()
    for _ in range(rng.integers(2, 5)):
        share = np.clip((cloud(rng, size, 2, 4) - rng.uniform(0.45, 0.7)) * rng.uniform(3, 30), 0, 1)
        picture += (colors.any_color(rng) - picture) * share[..., None]
    picture *= 1 + (cloud(rng, size, 8, 2)[..., None] - 0.5) * rng.uniform(0, 0.6)
    return as_texture(picture)


def emblem(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A logo on one or both sides of a wrapped surface."""
    picture = _canvas(base, size)
    height, width = size
    side = int(min(height * rng.uniform(0.3, 0.8), width * 0.3))
    turn = rng.uniform(0, 1)
    for k in range(rng.integers(1, 3)):
        patch = _canvas(base, (side, side))
        figure(rng, patch, (0, 0, side, side), base)
        if rng.random() < 0.4:
            write(rng, patch, (int(side * 0.6), 2, side // 4, side - 4), colors.against(rng, base))
        row = int((height - side) * rng.uniform(0.3, 0.7))
        picture[row : row + side, (np.arange(side) + int((turn + k * 0.5) * width)) % width] = patch
    return picture


def lettering(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One to three words, large, on one or both sides."""
    picture = _canvas(base, size)
    height, width = size
    color = colors.against(rng, base, 0.35)
    wide, turn, count = int(width * rng.uniform(0.2, 0.36)), rng.uniform(0, 1), int(rng.integers(1, 4))
    patch = _canvas(base, (int(height * 0.8), wide))
    for k in range(count):
        tall = patch.shape[0] // count
        write(rng, patch, (k * tall + 2, 2, int(tall * rng.uniform(0.5, 0.9)), wide - 4), color)
    for k in range(rng.integers(1, 3)):
        picture[
            int(height * 0.1) : int(height * 0.1) + patch.shape[0],
            (np.arange(wide) + int((turn + k / 2) * width)) % width,
        ] = patch
    return picture


def picture_print(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A photo printed on one or both sides, or all around."""
    picture = _canvas(base, size)
    height, width = size
    if rng.random() < 0.3:
        return photo(rng, base, size)
    tall, wide, turn = int(height * rng.uniform(0.4, 0.9)), int(width * rng.uniform(0.15, 0.4)), rng.uniform(0, 1)
    row = int((height - tall) * rng.uniform(0.2, 0.8))
    for k in range(rng.integers(1, 3)):
        patch = photo(rng, base, (tall, wide))
        picture[row : row + tall, (np.arange(wide) + int((turn + k * 0.5) * width)) % width] = patch
    return picture


def label(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A product's label: a coloured band with a brand, a picture, stripes and small print."""
    height, width = size
    ground = colors.against(rng, base, 0.15) if rng.random() < 0.8 else base
    picture = _canvas(ground, size)
    if rng.random() < 0.4:
        second = colors.against(rng, ground)
        edge = int(height * rng.uniform(0.3, 0.7))
        picture[edge:] = as_texture(second)
    if rng.random() < 0.3:
        tall = int(height * rng.uniform(0.3, 0.6))
        picture[-tall:] = photo(rng, ground, (tall, width))
    turn, repeats = rng.uniform(0, 1), int(rng.integers(1, 3))
    front = picture[:, : width // 3].copy()
    if rng.random() < 0.7:
        figure(rng, front, (int(height * 0.4), 4, int(height * 0.5), width // 3 - 8), ground)
    write(
        rng,
        front,
        (int(height * rng.uniform(0.05, 0.3)), 4, int(height * 0.28), width // 3 - 8),
        colors.against(rng, ground, 0.4),
    )
    for k in range(repeats):
        picture[:, (np.arange(width // 3) + int((turn + k / repeats) * width)) % width] = front
    back = picture[:, : width // 8].copy()
    lines(rng, back, (int(height * 0.15), 3, int(height * 0.7), width // 8 - 6), colors.against(rng, ground))
    picture[:, (np.arange(width // 8) + int((turn + 0.36) * width)) % width] = back
    for edge_row in (0, height - max(2, height // 20)):
        if rng.random() < 0.5:
            picture[edge_row : edge_row + max(2, height // 20)] = as_texture(colors.against(rng, ground))
    return picture


def nameplate(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One word on the ground's own colour."""
    picture = _canvas(base, size)
    ink = colors.white(rng) if base.mean() < 0.5 else colors.black(rng)
    write(rng, picture, (2, 2, size[0] - 6, size[1] - 4), ink)
    return picture
