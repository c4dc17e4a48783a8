"""Text on pictures: labels, axes' letters and captions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

INK, PAPER = (30, 30, 30), (255, 255, 255)
# Height of a line of OpenCV's lettering at font scale 1.
LINE = 30.0


def draw_text(picture: Picture, text: str, x: float, y: float, ink: Colour, height: float) -> None:
    """Draw text in a line ``height`` pixels high whose left end's middle is at (x, y)."""
    spot = (round(x), round(y + 0.3 * height))
    cv2.putText(picture, text, spot, cv2.FONT_HERSHEY_SIMPLEX, height / LINE, ink, 1, cv2.LINE_AA)


def text_width(text: str, height: float) -> float:
    """Return the width in pixels of text that is ``height`` pixels high."""
    return float(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, height / LINE, 1)[0][0])


def draw_tag(picture: Picture, name: str, place: Tensor, colour: Colour, thick: float) -> None:
    """Draw a white letter on a disc of the axis's colour."""
    x, y = place.clamp(-1e4, 1e4).tolist()
    cv2.circle(picture, (round(x), round(y)), round(6 * thick), colour, -1, cv2.LINE_AA)
    draw_text(picture, name, x - text_width(name, 12 * thick) / 2, y - 0.6 * thick, PAPER, 12 * thick)


def draw_label(picture: Picture, label: str, thick: float) -> None:
    """Draw a dark label on a white plate in the upper left corner, broken at its commas if the picture is narrow."""
    height, lines = 14 * thick, [""]
    room = picture.shape[1] - height
    for part in label.split(", "):
        longer = f"{lines[-1]}, {part}" if lines[-1] else part
        if lines[-1] and text_width(longer, height) > room:
            lines[-1] += ","
            lines.append(part)
        else:
            lines[-1] = longer
    widest = max(1.0, *(text_width(line, height) for line in lines))
    height *= min(1.0, room / widest)
    right = round(widest * min(1.0, room / widest) + height)
    cv2.rectangle(picture, (0, 0), (right, round(1.4 * height * len(lines))), PAPER, -1)
    for number, line in enumerate(lines):
        draw_text(picture, line, height / 2, (0.7 + 1.4 * number) * height, INK, height)


def caption_strip(caption: str, width: int, thick: float) -> Picture:
    """Return the caption on white, smaller if a line would not fit."""
    lines, height = caption.splitlines() or [""], 14 * thick
    height *= min(1.0, (width - height) / max(1.0, *(text_width(line, height) for line in lines)))
    strip = np.full((round((1.4 * len(lines) + 0.6) * height), width, 3), 255, np.uint8)
    for k, line in enumerate(lines):
        draw_text(strip, line, height / 2, (1.4 * k + 1) * height, INK, height)
    return strip
