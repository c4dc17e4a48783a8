"""Objects of kfit's categories in a photo: where they are, which category each is of, and their masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from kfit.features.category_classifier import NAMES, NONE, CategoryClassifier, object_square
from kfit.geometry import CATEGORIES
from kfit.segmentation import Box, OnnxNetwork, SalientObject, Segment, Segmenter
from kfit.segmentation.object_detector import CLASSES, ObjectDetector, iou
from kfit.segmentation.salient_object import SURROUND, U2NET

# Classes of the detector that are of a category.
DETECTED = {"bottle": ("Bottle",), "camera": ("Camera",), "laptop": ("Laptop",), "mug": ("Mug", "Coffee cup")}
# Its classes that speak for none of them.
LIVING = ("Person", "Cattle", "Cat", "Dog")
# Its classes of things of another size, whose boxes tell nothing about the place of an object.
SURROUNDINGS = ("Person", "Chair", "Cattle", "Desk", "Cat", "Stationary bicycle", "Table", "Dog", "Bicycle", "Book")
# Margin, in longer sides of a box, with which the classifier sees an object.
MARGIN = 0.15
# What stands out and has this share of the photo may be an object, as likely as a box of this score.
LEAST_PART, PART_SCORE = 0.005, 0.3
# Boxes of fewer pixels a side, or of a smaller share of the photo's longer side, hold too little.
LEAST_SIDE, LEAST_SHARE = 12, 0.03
# A detector's score of 0.1 says nothing; of its logarithm above that, this much adds to the classifier's, for a
# category and for none.
SILENT, DETECTOR_WEIGHT, LIVING_WEIGHT = 0.1, 0.5, 1.0
# An object is reported from this probability of its category, and from this product of it with the box's score. Where
# there is none, one of lower numbers is, as a guess.
PROBABLE, SEEN = 0.5, 0.1
GUESS, GUESS_SEEN = 0.25, 0.03
# Of several, each has this share of the best one's product; parts of an object look like the whole.
LEAST_OF_BEST = 0.2
# A mask whose box has less IoU with the box it was looked for in shows another thing.
AGREES = 0.4
# A box that fits what stands out by this IoU frames it.
SALIENT = 0.6
# Two boxes of this IoU, or one inside the other by this share and of one category, hold one object.
SAME, INSIDE = 0.4, 0.7
# Boxes of the detector are off by about this share of their sides.
SLACK = 0.03


@dataclass(frozen=True)
class FoundObject(Segmenter):
    """An object in a photo; as a segmenter it is its own mask.

    Attributes:
        category: one of `kfit.geometry.CATEGORIES`.
        score: probability that it is of that category, in [0, 1].
        box: left, top, width, height in pixels: of the mask.
        segment: its mask.
    """

    category: str
    score: float
    box: Box
    segment: Segment

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        return self.segment


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
    def _salient(self) -> SalientObject:
        return SalientObject(OnnxNetwork(U2NET))

    def find(self, image: NDArray[np.float32], categories: Sequence[str] = tuple(CATEGORIES)) -> list[FoundObject]:
        """Find all objects of some categories in a photo (H, W, 3), RGB in [0, 1]; those seen best first.

        Where no object is probable, the likeliest may be given, with a score below one half.
        """
        boxes, scores, certainty = self.candidates(image)
        wanted = [NAMES.index(name) for name in categories]
        shares = self.probabilities(image, boxes, scores)[:, wanted]
        best = shares.max(1, initial=0)
        rank = best * certainty
        for probable, seen_by in ((PROBABLE, SEEN), (GUESS, GUESS_SEEN)):
            found: list[FoundObject] = []
            least = max(seen_by, LEAST_OF_BEST * float(rank[best >= probable].max(initial=0)))
            for number in np.argsort(-rank, kind="stable"):
                if best[number] < probable or rank[number] < least:
                    continue
                category = categories[int(shares[number].argmax())]
                if _is_new(boxes[number], category, found):
                    one = self._cut_out(image, boxes[number], category, float(best[number]))
                    if one is not None and _is_new(_corners(one.box), category, found):
                        found.append(one)
                if found and probable == GUESS:
                    break
            if found:
                return found
        return []

    def candidates(
        self, image: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Boxes (N, 4), left, top, right, bottom, the detector's scores of its 23 classes there (N, 23), and how surely
        each box frames an object at all (N,)."""
        proposals = self._detector(image)
        boxes, scores = [*proposals.boxes], [*proposals.scores]
        framing = proposals.scores[:, [name not in SURROUNDINGS for name in CLASSES]].max(1, initial=0)
        there = (self._salient.saliency(image) > 0.5).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(there)
        for left, top, width, height, area in stats[1:].tolist():
            box = np.array([left, top, left + width, top + height], np.float64)
            if area < LEAST_PART * there.size:
                continue
            same = iou(box[None], proposals.boxes)[0] > SALIENT
            framing[: len(same)][same] = np.maximum(framing[: len(same)][same], PART_SCORE)
            if not same.any():
                boxes.append(box)
                scores.append(proposals.scores[iou(box[None], proposals.boxes)[0] > SAME].max(0, initial=0))
                framing = np.append(framing, PART_SCORE)
        kept = np.array(boxes).reshape(-1, 4)
        large = (kept[:, 2:] - kept[:, :2]).min(1, initial=np.inf) >= max(LEAST_SIDE, LEAST_SHARE * max(there.shape))
        return kept[large], np.array(scores).reshape(-1, len(CLASSES))[large], framing[large]

    def probabilities(
        self, image: NDArray[np.float32], boxes: NDArray[Any], scores: NDArray[Any] | None = None
    ) -> NDArray[np.float64]:
        """Probability (N, 7) of the categories and of none of them, in the order of `NAMES`, for what boxes hold.

        Args:
            image: (H, W, 3), RGB in [0, 1].
            boxes: (N, 4) left, top, right, bottom in pixels.
            scores: (N, 23) of the detector there; it looks at the photo where they are not given.
        """
        if not len(boxes):
            return np.zeros((0, len(NAMES)))
        with torch.no_grad():
            certainty = _classifier()(torch.stack([object_square(image, box, MARGIN) for box in boxes]))
        logits = certainty.double().numpy()
        if scores is None:
            proposals = self._detector(image)
            near = iou(np.asarray(boxes), proposals.boxes) > SAME
            scores = np.stack([proposals.scores[row].max(0, initial=0) for row in near])
        for category, classes in (DETECTED | {NONE: LIVING}).items():
            score = scores[:, [CLASSES.index(name) for name in classes]].max(1)
            weight = LIVING_WEIGHT if category == NONE else DETECTOR_WEIGHT
            logits[:, NAMES.index(category)] += weight * np.log(np.maximum(score, SILENT) / SILENT)
        shares = np.exp(logits - logits.max(1, keepdims=True))
        return np.asarray(shares / shares.sum(1, keepdims=True), np.float64)

    def salient_share(self, image: NDArray[np.float32], there: NDArray[np.bool_]) -> float:
        """The share of a mask (H, W), not empty, that stands out in its box and a quarter around it."""
        left, top, width, height = (round(part) for part in box_of(there))
        across, down = round(SURROUND * width), round(SURROUND * height)
        around = np.s_[max(0, top - down) : top + height + down, max(0, left - across) : left + width + across]
        return float((self._salient.saliency(image[around]) > 0.5)[there[around]].mean())

    def _cut_out(
        self, image: NDArray[np.float32], corners: NDArray[Any], category: str, score: float
    ) -> FoundObject | None:
        """The object in a box of the detector, which may be off; None where what stands out there is another thing."""
        reach = SLACK * np.tile(corners[2:] - corners[:2], 2) * (-1, -1, 1, 1)
        left, top, right, bottom = (corners + reach).tolist()
        try:
            segment = self._salient(image, category, (left, top, right - left, bottom - top))
        except ValueError:  # nothing stands out
            return None
        box = box_of(segment.mask)
        if iou(corners[None], _corners(box)[None]).item() < AGREES:
            return None
        return FoundObject(category, score, box, segment)


def _is_new(corners: NDArray[Any], category: str, found: Sequence[FoundObject]) -> bool:
    """Whether a box holds an object of a category that is none of those that were found."""
    for other in found:
        mine, theirs = corners[None], _corners(other.box)[None]
        low, high = np.maximum(mine[:, :2], theirs[:, :2]), np.minimum(mine[:, 2:], theirs[:, 2:])
        smaller = min(float((box[:, 2:] - box[:, :2]).prod()) for box in (mine, theirs))
        inside = float((high - low).clip(0).prod()) / max(smaller, 1.0)
        if iou(mine, theirs).item() > SAME or (other.category == category and inside > INSIDE):
            return False
    return True


def box_of(mask: NDArray[Any]) -> Box:
    """Left, top, width and height of a mask's box."""
    left, top, width, height = cv2.boundingRect((np.asarray(mask) > 0.5).astype(np.uint8))
    return float(left), float(top), float(width), float(height)


def _corners(box: Box) -> NDArray[np.float64]:
    return np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]])


@lru_cache
def _classifier() -> CategoryClassifier:
    return CategoryClassifier()
