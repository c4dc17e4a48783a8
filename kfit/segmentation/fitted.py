"""Resizing a photo for a network, and mapping results back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Fitted:
    """A photo on a canvas.

    Attributes:
        pixels: (h, w, 3), the canvas.
        frame: (4,) left, top, right, bottom in pixels of the photo of what the canvas spans, margins included.
    """

    pixels: NDArray[np.float32]
    frame: NDArray[np.float64]

    @staticmethod
    def on(
        canvas: tuple[int, int],
        image: NDArray[np.float32],
        size: tuple[int, int],
        place: tuple[int, int] = (0, 0),
        margin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Fitted:
        """Scale a photo (H, W, 3) to ``size`` (h, w) and lay it on a canvas (h, w) at ``place`` (top, left)."""
        pixels = np.full((*canvas, 3), margin, np.float32)
        pixels[place[0] : place[0] + size[0], place[1] : place[1] + size[1]] = resized(image, size)
        across, down = image.shape[1] / size[1], image.shape[0] / size[0]
        left, top = -place[1] * across, -place[0] * down
        return Fitted(pixels, np.array([left, top, left + canvas[1] * across, top + canvas[0] * down]))

    def to_photo(self, boxes: NDArray[Any]) -> NDArray[np.float64]:
        """Boxes (N, 4), left, top, right, bottom, from pixels of the canvas to pixels of the photo."""
        height, width = self.pixels.shape[:2]
        step = (self.frame[2:] - self.frame[:2]) / (width, height)
        taken: NDArray[np.float64] = boxes.astype(np.float64) * np.tile(step, 2) + np.tile(self.frame[:2], 2)
        return taken


def resized(image: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Resize a picture (H, W) or (H, W, 3) to ``size`` (h, w), by area means if it becomes smaller."""
    shrinks = size[0] * size[1] < image.shape[0] * image.shape[1]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    taken: NDArray[np.float32] = cv2.resize(np.ascontiguousarray(image), (size[1], size[0]), interpolation=how)
    return taken


def within(shape: tuple[int, int], canvas: tuple[int, int]) -> tuple[int, int]:
    """The largest size (h, w) with the proportions of ``shape`` (H, W) that fits a canvas (h, w)."""
    scale = min(canvas[0] / shape[0], canvas[1] / shape[1])
    height, width = (max(1, min(side, round(scale * own))) for side, own in zip(canvas, shape, strict=True))
    return height, width
