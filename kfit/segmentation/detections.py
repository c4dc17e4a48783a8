"""Detections in a photo, by a detector or from files."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.classes import category_of
from kfit.segmentation.segmenter import Box, Segment, Segmenter, clipped, spell

# A detection is the object in a user's box if their boxes overlap by this IoU.
SAME = 0.5


@dataclass(frozen=True)
class Detections(Segmenter):
    """N objects found in one photo; as a segmenter it selects one of them.

    In a box it selects the detection whose box overlaps most, of any class; else the best one of the category.

    Attributes:
        shape: (H, W) of the photo.
        boxes: (N, 4) left, top, right, bottom in pixels of the photo.
        scores: (N,) in [0, 1].
        names: N names of classes, as the detector spells them.
        masks: (N, h, w), above 1/2 on the object.
        frames: (N, 4) left, top, right, bottom of the part of the photo that each mask spans.
    """

    shape: tuple[int, int]
    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    names: list[str]
    masks: NDArray[Any]
    frames: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = len(self.names)
        parts = {"boxes": self.boxes, "scores": self.scores, "masks": self.masks, "frames": self.frames}
        wanted = {"boxes": (count, 4), "scores": (count,), "frames": (count, 4)}
        for name, part in parts.items():
            if (part.ndim, len(part)) != (3, count) if name == "masks" else part.shape != wanted[name]:
                want = f"({count}, h, w)" if name == "masks" else wanted[name]
                raise ValueError(f"{name} must have shape {want} for {count} names, got {part.shape}")

    @property
    def categories(self) -> list[str | None]:
        """kfit's category of each, or None."""
        return [category_of(name) for name in self.names]

    def mask(self, index: int) -> NDArray[np.float32]:
        """Return the mask (H, W) of one detection, 1 on the object and 0 elsewhere; it lies in its box."""
        height, width = self.shape
        mask = np.zeros(self.shape, np.float32)
        low = np.clip(np.round(self.boxes[index][:2]), 0, (width, height)).astype(int)
        high = np.clip(np.round(self.boxes[index][2:]), 0, (width, height)).astype(int)
        if (high <= low).any():
            return mask
        small = self.masks[index]
        corner, size = self.frames[index][:2], self.frames[index][2:] - self.frames[index][:2]
        # Pixel centres lie half a pixel from the frame's border, in the photo and in the mask alike.
        step = np.array([small.shape[1], small.shape[0]]) / size
        start = step * (low + 0.5 - corner) - 0.5
        matrix = np.array([[step[0], 0, start[0]], [0, step[1], start[1]]])
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        source, size_out = np.ascontiguousarray(small, np.float32), (high - low).tolist()
        large = cv2.warpAffine(source, matrix, size_out, flags=how, borderMode=cv2.BORDER_REPLICATE)
        mask[low[1] : high[1], low[0] : high[0]] = large > 0.5
        return mask

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        if image.shape[:2] != tuple(self.shape):
            raise ValueError(
                f"the detections are of a photo of {self.shape[1]} x {self.shape[0]} pixels, "
                f"this one has {image.shape[1]} x {image.shape[0]}"
            )
        index, notes = self._of(category) if box is None else self._in(box, category)
        mask = self.mask(index)
        if not mask.any():
            raise ValueError(f"the mask of the detected {self._named([index])} is empty")
        return Segment(mask, tuple(notes))

    def _shows(self, index: int, category: str) -> bool:
        """Whether a detection is of a category: one of kfit's by any of its words, one of your own by its name."""
        return self.categories[index] == category or self.names[index].lower() == category.lower()

    def _of(self, category: str) -> tuple[int, list[str]]:
        there = [index for index in range(len(self.names)) if self._shows(index, category)]
        if not there:
            others = self._named(np.argsort(-self.scores, kind="stable")[:5].tolist()) or "nothing at all"
            raise ValueError(
                f"no {category} was detected in the photo, but {others}; use a box to select another object"
            )
        best = max(there, key=lambda index: float(self.scores[index]))
        if len(there) == 1:
            return best, []
        others = self._named([index for index in there if index != best][:5])
        return best, [f"the surest of {len(there)} detections was taken, {self._named([best])}, and not {others}"]

    def _in(self, box: Box, category: str) -> tuple[int, list[str]]:
        left, top, right, bottom = clipped(box, self.shape[1], self.shape[0])
        low, high = np.maximum(self.boxes[:, :2], (left, top)), np.minimum(self.boxes[:, 2:], (right, bottom))
        common = (high - low).clip(0).prod(1)
        both = (self.boxes[:, 2:] - self.boxes[:, :2]).clip(0).prod(1) + (right - left) * (bottom - top) - common
        overlap = common / both
        if not len(overlap) or overlap.max() < SAME:
            nearest = f"; nearest is {self._named([int(overlap.argmax())])}" if (overlap > 0).any() else ""
            raise ValueError(f"no detection fills box {spell(box)}{nearest}")
        best = int(overlap.argmax())
        if self._shows(best, category):
            return best, []
        return best, [f"the detector takes the object in the box for another than a {category}: {self._named([best])}"]

    def _named(self, indices: list[int]) -> str:
        places = ["{:.0f} {:.0f} {:.0f} {:.0f}".format(*self._xywh(index)) for index in indices]
        return ", ".join(
            f"{self.names[index]!r} ({100 * self.scores[index]:.0f} %, box {place})"
            for index, place in zip(indices, places, strict=True)
        )

    def _xywh(self, index: int) -> tuple[float, float, float, float]:
        left, top, right, bottom = self.boxes[index].tolist()
        return left, top, right - left, bottom - top


class Detector(Segmenter):
    """Finds objects of many classes.

    Attributes:
        classes: all names of its classes.
    """

    classes: Collection[str]

    @abstractmethod
    def detect(self, image: NDArray[np.float32]) -> Detections:
        """Return all objects in a photo (H, W, 3), RGB in [0, 1]."""

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        words = {category_of(name) for name in self.classes} | {name.lower() for name in self.classes}
        if box is None and not words & {category, category.lower()}:
            some = ", ".join(list(self.classes)[:8]) + (", …" if len(self.classes) > 8 else "")
            raise ValueError(
                f"none of the segmenter's {len(self.classes)} classes ({some}) is a {category}; a box around the "
                "object selects it without its class"
            )
        return self.detect(image)(image, category, box)
