"""What is drawn on a laptop: the deck with its keyboard, the screen and what it shows, and the lid's back."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.textures import Family, as_texture

_WIDTH = 320


def _canvas(color: np.ndarray, height: int, width: int = _WIDTH) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(as_texture(color), (height, width, 3)))


def _fill(picture: np.ndarray, box: tuple[float, float, float, float], color: np.ndarray, line: int = -1) -> None:
    """Fill a box given as shares (top, left, bottom, right) of the picture."""
    height, width = picture.shape[:2]
    top, left, bottom, right = box
    start, stop = (int(left * width), int(top * height)), (int(right * width), int(bottom * height))
    red, green, blue = (int(c) for c in as_texture(color))
    cv2.rectangle(picture, start, stop, (red, green, blue), line)


def deck(rng: np.random.Generator, color: np.ndarray, depth: float) -> np.ndarray:
    """Keyboard, trackpad, and sometimes a number pad and stickers, seen from above with the hinge at the top."""
    picture = _canvas(color, int(_WIDTH * depth))
    left = rng.choice([0.03, 0.05, rng.uniform(0.08, 0.15)])
    right, top, bottom = 1 - left, rng.uniform(0.08, 0.2), rng.uniform(0.5, 0.62)
    dark = rng.random() < 0.75
    key = colors.black(rng) if dark else colors.against(rng, color, 0.08)
    if rng.random() < 0.5:
        tray = np.clip(color * rng.uniform(0.4, 0.9), 0, 1)
        _fill(picture, (top - 0.015, left - 0.012, bottom + 0.015, right + 0.012), tray)
    legend = colors.white(rng) if key.mean() < 0.5 else colors.black(rng)
    rows, columns = 6, int(rng.integers(13, 16))
    spans = [(left, right)]
    if rng.random() < 0.3:
        spans = [(left, left + (right - left) * 0.77), (left + (right - left) * 0.8, right)]
    gap = rng.uniform(0.08, 0.25)
    for start, stop in spans:
        count = columns if len(spans) == 1 or start == left else 4
        for row in range(rows):
            pitch, step = (stop - start) / count, (bottom - top) / rows
            for column in range(count):
                x, y = start + column * pitch, top + row * step
                wide = pitch * (1 - gap)
                if row == rows - 1 and count > 4 and 3 <= column <= 8:
                    x, wide = (start + 3 * pitch, pitch * (6 - gap)) if column == 3 else (x, 0.0)
                if wide > 0:
                    _fill(picture, (y, x, y + step * (1 - gap), x + wide), key)
                    if rng.random() < 0.7:
                        _fill(picture, (y + step * 0.3, x + wide * 0.3, y + step * 0.4, x + wide * 0.5), legend)
    middle, half = rng.choice([0.5, rng.uniform(0.4, 0.5)]), rng.uniform(0.1, 0.2)
    pad = np.clip(color * rng.choice([0.93, 1.06, 0.7]) + (0.06 if color.mean() < 0.2 else 0), 0, 1)
    pad_box = (bottom + rng.uniform(0.05, 0.08), middle - half, rng.uniform(0.88, 0.96), middle + half)
    _fill(picture, pad_box, pad)
    _fill(picture, pad_box, np.clip(pad * 0.7 + 0.05, 0, 1), 1)
    _stickers(rng, picture, (0.75, 0.95), color, float(rng.choice([0, 0, 1, 2])))
    return picture


def _stickers(
    rng: np.random.Generator, picture: np.ndarray, rows: tuple[float, float], base: np.ndarray, count: float
) -> None:
    height, width = picture.shape[:2]
    for _ in range(int(count)):
        tall, wide = int(height * rng.uniform(0.06, 0.12)), int(width * rng.uniform(0.05, 0.1))
        row = int(height * rng.uniform(rows[0], rows[1] - 0.12))
        column = int(width * (rng.uniform(0.03, 0.2) if rng.random() < 0.5 else rng.uniform(0.75, 0.87)))
        ground = colors.any_color(rng)
        picture[row : row + tall, column : column + wide] = as_texture(ground)
        prints.figure(rng, picture, (row, column, tall, wide), ground)


def screen(rng: np.random.Generator, family: Family, frame: np.ndarray, depth: float, border: float) -> np.ndarray:
    """The lid's inner face: a frame whose width ``border`` scales, the display in it, a lens, sometimes a name."""
    height = int(_WIDTH * depth)
    picture = _canvas(frame, height)
    side = border * rng.uniform(0.015, 0.07)
    top, bottom = border * rng.uniform(0.025, 0.09), min(0.25, border * rng.uniform(0.05, 0.16))
    box = (int(top * height), int(side * _WIDTH), int((1 - bottom) * height), int((1 - side) * _WIDTH))
    size = (box[2] - box[0], box[3] - box[1])
    picture[box[0] : box[2], box[1] : box[3]] = cv2.resize(family(rng, frame, size), size[::-1])
    if rng.random() < 0.7:
        lens = (_WIDTH // 2, int(top * height / 2))
        cv2.circle(picture, lens, 2, (20, 20, 28) if frame.mean() > 0.2 else (90, 90, 100), -1, cv2.LINE_AA)
    if rng.random() < 0.4:
        tall = max(3, int(bottom * height * 0.4))
        prints.write(rng, picture, (box[2] + tall // 2, _WIDTH // 2 - 25, tall, 50), colors.against(rng, frame))
    return picture


def back(rng: np.random.Generator, color: np.ndarray, depth: float, covers: Sequence[Family]) -> np.ndarray:
    """The lid's outer face: plain, with a logo or lettering in its middle, or half of them with one of ``covers``."""
    height = int(_WIDTH * depth)
    picture = _canvas(color, height)
    if covers and rng.random() < 0.5:
        return covers[int(rng.integers(len(covers)))](rng, color, (height, _WIDTH))
    kind = rng.random()
    side = int(height * rng.uniform(0.1, 0.25))
    box = (int(height / 2 - side / 2), int(_WIDTH / 2 - side / 2), side, side)
    if kind < 0.4:
        prints.figure(rng, picture, box, color)
    elif kind < 0.65:
        prints.write(
            rng, picture, (box[0] + side // 4, box[1] - side // 2, side // 2, 2 * side), colors.against(rng, color)
        )
    elif kind < 0.75:
        _stickers(rng, picture, (0.1, 0.9), color, float(rng.integers(1, 5)))
    return picture


def off(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A dark display with a soft reflection."""
    dark = colors.black(rng) * 0.8
    return as_texture(dark + 0.12 * textures.cloud(rng, size, 1, 1)[..., None] * (rng.random() < 0.6))


def wallpaper(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A picture or a colour gradient."""
    if rng.random() < 0.5:
        return prints.photo(rng, base, size)
    corner, other = colors.hue(rng), colors.any_color(rng)
    share = np.add.outer(np.linspace(0, 1, size[0]), np.linspace(0, 1, size[1]))[..., None] / 2
    return as_texture(corner + (other - corner) * share)


def desktop(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A wallpaper with icons and a task bar."""
    picture = wallpaper(rng, base, size)
    bar = colors.black(rng) if rng.random() < 0.6 else colors.white(rng)
    _fill(picture, (0.94, 0, 1, 1) if rng.random() < 0.7 else (0, 0, 0.04, 1), bar)
    for k in range(rng.integers(0, 14)):
        y, x = 0.05 + 0.12 * (k % 7), 0.03 + 0.07 * (k // 7)
        _fill(picture, (y, x, y + 0.06, x + 0.04), colors.any_color(rng, 0.4))
    return picture


def windows(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A desktop with one to three windows of text or pictures."""
    picture = desktop(rng, base, size)
    for _ in range(rng.integers(1, 4)):
        top, left = rng.uniform(0.03, 0.35), rng.uniform(0.03, 0.4)
        bottom, right = min(0.93, top + rng.uniform(0.35, 0.8)), min(0.98, left + rng.uniform(0.3, 0.8))
        sheet = colors.white(rng) if rng.random() < 0.7 else colors.black(rng)
        _fill(picture, (top, left, bottom, right), sheet)
        _fill(picture, (top, left, top + 0.05, right), colors.any_color(rng, 0.4))
        box = (int((top + 0.09) * size[0]), int((left + 0.03) * size[1]))
        room = (int((bottom - top - 0.12) * size[0]), int((right - left - 0.06) * size[1]))
        if rng.random() < 0.3 and min(room) > 8:
            picture[box[0] : box[0] + room[0], box[1] : box[1] + room[1]] = prints.photo(rng, base, room)
        else:
            prints.lines(rng, picture, (*box, *room), colors.against(rng, sheet, 0.4))
    return picture


def document(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """One page of text over the whole display."""
    picture = _canvas(colors.white(rng), *size)
    _fill(picture, (0, 0, rng.uniform(0.05, 0.15), 1), colors.any_color(rng, 0.4))
    side = rng.uniform(0.05, 0.3)
    box = (int(0.2 * size[0]), int(side * size[1]), int(0.75 * size[0]), int((1 - 2 * side) * size[1]))
    prints.lines(rng, picture, box, colors.black(rng))
    return picture


def patchwork(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Boxes of any place and colour, some with text in them: a display of no family."""
    picture = wallpaper(rng, base, size) if rng.random() < 0.3 else _canvas(colors.any_color(rng), *size)
    for _ in range(rng.integers(1, 9)):
        top, left = rng.uniform(-0.1, 0.8, 2)
        tall, wide = np.exp(rng.uniform(-3, 0, 2))
        ground = colors.any_color(rng)
        _fill(picture, (top, left, top + tall, left + wide), ground)
        box = [int(share * side) for share, side in zip((max(top, 0), max(left, 0), tall, wide), size * 2, strict=True)]
        if rng.random() < 0.5:
            prints.lines(rng, picture, (box[0], box[1], box[2], box[3]), colors.against(rng, ground))
    return picture


def editor(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A dark editor with coloured lines and a side bar."""
    picture = _canvas(colors.black(rng), *size)
    _fill(picture, (0, 0, 1, rng.uniform(0.08, 0.25)), colors.black(rng) + 0.05)
    for k in range(10):
        row = int((0.04 + 0.09 * k) * size[0])
        column = int(rng.uniform(0.27, 0.4) * size[1])
        prints.lines(
            rng,
            picture,
            (row, column, int(0.08 * size[0]), int(0.5 * size[1])),
            colors.hue(rng, None, (0.2, 0.8), (0.6, 1)),
        )
    return picture


def film(rng: np.random.Generator, base: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A film with black bars above and below."""
    picture = prints.photo(rng, base, size)
    bar = rng.uniform(0.08, 0.18)
    _fill(picture, (0, 0, bar, 1), np.zeros(3))
    _fill(picture, (1 - bar, 0, 1, 1), np.zeros(3))
    return picture


def framed(rng: np.random.Generator, picture: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """A picture with a frame of one colour around it."""
    result = picture.copy()
    line = max(2, int(min(picture.shape[:2]) * rng.uniform(0.03, 0.1)))
    inner = result[line:-line, line:-line].copy()
    result[:] = as_texture(frame)
    result[line:-line, line:-line] = inner
    return result
