"""Objects of kfit's categories in a photo: where they are, which category each is of, and their masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from kfit.segmentation.object_mask import ObjectMask
from numpy.typing import NDArray

from kfit.features.category_classifier import NAMES, CategoryClassifier, object_square
from kfit.geometry import CATEGORIES
from kfit.segmentation import Segment
from kfit.segmentation.object_detector import CLASSES, ObjectDetector, iou

# Classes of the detector that are of a category.
DETECTED = {"bottle": ("Bottle",), "camera": ("Camera",), "laptop": ("Laptop",), "mug": ("Mug", "Coffee cup")}
# Margins, in longer sides of a box, with which the classifier sees an object; its features are averaged.
MARGINS = (0.1, 0.25)
# What stands out and has this share of the photo may be an object.
LEAST_PART = 0.005
# Boxes of fewer pixels a side, or of a smaller share of the photo's longer side, hold too little.
LEAST_SIDE, LEAST_SHARE = 16, 0.03
# A detector's score of 0.1 says nothing; of its logarithm above that, this much adds to the classifier's.
SILENT, DETECTOR_WEIGHT = 0.1, 0.5
# Least probability of a category for an object to be reported.
LEAST_PROBABILITY = 0.5
# Two boxes of this IoU, or one inside the other by this share and of one category, hold one object.
SAME, INSIDE = 0.5, 0.8


@dataclass(frozen=True)
class FoundObject:
    """An object in a photo.

    Attributes:
        category: one of `kfit.geometry.CATEGORIES`.
        score: probability that it is of that category, in [0, 1].
        box: left, top, width, height in pixels: of the mask.
        segment: its mask.
    """

    category: str
    score: float
    box: tuple[float, float, float, float]
    segment: Segment


class ObjectFinder:
    """Finds bottles, bowls, cameras, cans, laptops and mugs.

    Candidates are the boxes of `kfit.segmentation.ObjectDetector`, whatever class it takes them for, and what stands
    out in the whole photo by U²-Net and is in none of them. `kfit.features.CategoryClassifier` tells the probability of
    each category; where the detector knows the category, the logarithm of its score counts too. Of boxes around one
    object the most probable stays, and U²-Net cuts the object out of it.

    >>> from skimage.data import coffee
    >>> [cup] = ObjectFinder().find(coffee() / np.float32(255))
    >>> cup.category
    'mug'
    """

    @cached_property
    def _detector(self) -> ObjectDetector:
        return ObjectDetector()

    @cached_property
    def _mask(self) -> ObjectMask:
        return ObjectMask()

    def find(self, image: NDArray[np.float32], categories: Sequence[str] = tuple(CATEGORIES)) -> list[FoundObject]:
        """Find all objects of some categories in a photo (H, W, 3), RGB in [0, 1]; the most probable first."""
        boxes, scores = self.candidates(image)
        probabilities = self.probabilities(image, boxes, scores)
        wanted = [NAMES.index(name) for name in categories]
        best = probabilities[:, wanted].max(1) if len(boxes) else np.zeros(0)
        kinds = [categories[int(row.argmax())] for row in probabilities[:, wanted]]
        found: list[FoundObject] = []
        for number in np.argsort(-best, kind="stable"):
            if best[number] < LEAST_PROBABILITY:
                break
            taken = np.array([_corners(other.box) for other in found]).reshape(-1, 4)
            segment = self._segment(image, boxes[number], kinds[number])
            if segment is None:
                continue
            box = _corners(box_of(segment.mask))
            if self._is_other(np.array([boxes[number], box]), kinds[number], taken, found):
                found.append(FoundObject(kinds[number], float(best[number]), box_of(segment.mask), segment))
        return found

    def candidates(self, image: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Boxes (N, 4), left, top, right, bottom, and what the detector scores its 23 classes there (N, 23)."""
        proposals = self._detector(image)
        boxes, scores = [*proposals.boxes], [*proposals.scores]
        there = (self._mask.salient.saliency(image) > 0.5).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(there)
        for left, top, width, height, area in stats[1:].tolist():
            box = np.array([left, top, left + width, top + height], np.float64)
            if area >= LEAST_PART * there.size and not (iou(box[None], proposals.boxes) > SAME).any():
                boxes.append(box)
                scores.append(np.zeros(len(CLASSES)))
        kept = np.array(boxes).reshape(-1, 4)
        large = (kept[:, 2:] - kept[:, :2]).min(1, initial=np.inf) >= max(LEAST_SIDE, LEAST_SHARE * max(there.shape))
        return kept[large], np.array(scores).reshape(-1, len(CLASSES))[large]

    def probabilities(
        self, image: NDArray[np.float32], boxes: NDArray[Any], scores: NDArray[Any] | None = None
    ) -> NDArray[np.float64]:
        """Probability (N, 7) of the categories and of none of them, in the order of `NAMES`, for what boxes hold.

        Args:
            image: (H, W, 3), RGB in [0, 1].
            boxes: (N, 4) left, top, right, bottom in pixels.
            scores: (N, 23) of the detector, where it has seen the photo.
        """
        if not len(boxes):
            return np.zeros((0, len(NAMES)))
        classifier = _classifier()
        with torch.no_grad():
            seen = [
                classifier(torch.stack([object_square(image, box, margin) for margin in MARGINS])).mean(0)
                for box in boxes
            ]
        logits = torch.stack(seen).double().numpy()
        if scores is not None:
            for category, classes in DETECTED.items():
                score = scores[:, [CLASSES.index(name) for name in classes]].max(1)
                logits[:, NAMES.index(category)] += DETECTOR_WEIGHT * np.log(np.maximum(score, SILENT) / SILENT)
        shares = np.exp(logits - logits.max(1, keepdims=True))
        return np.asarray(shares / shares.sum(1, keepdims=True), np.float64)

    def _segment(self, image: NDArray[np.float32], corners: NDArray[Any], category: str) -> Segment | None:
        left, top, right, bottom = corners.tolist()
        try:
            return self._mask(image, category, (left, top, right - left, bottom - top))
        except ValueError:  # nothing stands out there
            return None

    @staticmethod
    def _is_other(
        candidates: NDArray[Any], category: str, taken: NDArray[np.float64], found: Sequence[FoundObject]
    ) -> bool:
        """Whether a box, as detected and as cut out (2, 4), holds another object than those that were found (M, 4)."""
        if not len(taken):
            return True
        if (iou(candidates, taken) > SAME).any():
            return False
        low, high = np.maximum(candidates[:, None, :2], taken[:, :2]), np.minimum(candidates[:, None, 2:], taken[:, 2:])
        common = (high - low).clip(0).prod(2)
        areas = [(boxes[:, 2:] - boxes[:, :2]).prod(1) for boxes in (candidates, taken)]
        inside = common / np.minimum(areas[0][:, None], areas[1][None])
        alike = np.array([other.category == category for other in found])
        return not (inside[:, alike] > INSIDE).any()


def box_of(mask: NDArray[Any]) -> tuple[float, float, float, float]:
    """Left, top, width and height of a mask's box."""
    left, top, width, height = cv2.boundingRect((np.asarray(mask) > 0.5).astype(np.uint8))
    return float(left), float(top), float(width), float(height)


def _corners(box: tuple[float, float, float, float]) -> NDArray[np.float64]:
    return np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]])


@lru_cache
def _classifier() -> CategoryClassifier:
    return CategoryClassifier()
