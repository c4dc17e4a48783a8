"""Finds the objects of kfit's categories in a photo: places, categories and masks."""

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

# The detector's classes of each category.
DETECTED = {"bottle": ("Bottle",), "camera": ("Camera",), "laptop": ("Laptop",), "mug": ("Mug", "Coffee cup")}
# Its classes that are evidence for none of them.
LIVING = ("Person", "Cattle", "Cat", "Dog")
# Its classes of things of another size, whose boxes do not locate objects.
SURROUNDINGS = ("Person", "Chair", "Cattle", "Desk", "Cat", "Stationary bicycle", "Table", "Dog", "Bicycle", "Book")
# Margin of the classifier's input around an object, as a fraction of the box's longer side.
MARGIN = 0.15
# A salient region with at least this fraction of the photo is a candidate, with the score of such a box.
LEAST_PART, PART_SCORE = 0.005, 0.3
# Smaller boxes, in pixels or as a fraction of the photo's longer side, are ignored.
LEAST_SIDE, LEAST_SHARE = 12, 0.03
# Scores of the detector up to 0.1 are ignored; above, this multiple of the logarithm of their ratio to it is added to
# the classifier's, for a category and for none.
SILENT, DETECTOR_WEIGHT, LIVING_WEIGHT = 0.1, 0.5, 1.0
# An object is reported above this probability of its category, and above this product of it with the box's score. If
# there is none, one object above lower thresholds is reported as a guess.
PROBABLE, COVERED = 0.5, 0.1
GUESS, GUESS_COVERED = 0.25, 0.03
# Of several objects, each needs this fraction of the best one's product, because parts resemble the object.
LEAST_OF_BEST = 0.2
# A mask whose box has less IoU with the searched box shows another object.
AGREES = 0.4
# IoU of a box and a salient region above which they frame the same object.
SALIENT = 0.6
# Two boxes above this IoU, or with this fraction of one inside the other and of one category, hold one object.
SAME, INSIDE = 0.4, 0.7
# Boxes of the detector are off by about this fraction of their sides.
SLACK = 0.03


@dataclass(frozen=True)
class FoundObject(Segmenter):
    """An object in a photo; as a segmenter it returns its mask.

    Attributes:
        category: its name.
        score: probability that it is of that category, in [0, 1]; None of a category that the classifier does not know.
        box: left, top, width, height in pixels: of the mask.
        segment: its mask.
        chosen: whether a person or a file chose the mask, which nothing may change then.
    """

    category: str
    score: float | None
    box: Box
    segment: Segment
    chosen: bool = False

    @property
    def words(self) -> str:
        """Its category and the probability of that, where there is one."""
        return self.category if self.score is None else f"{self.category} ({100 * self.score:.0f} %)"

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        return self.segment


class ObjectFinder:
    """Finds bottles, bowls, cameras, cans, laptops and mugs.

    Candidates are the boxes of `kfit.segmentation.ObjectDetector`, of any class, and regions outside of them that are
    salient in the whole photo by U²-Net. `kfit.features.CategoryClassifier` predicts the probability of each category;
    if the detector knows the category, the logarithm of its score is added. Of boxes around one object the most
    probable one is kept, and U²-Net segments the object in it.

    Example:
        >>> from skimage.data import coffee
        >>> from kfit.pose.object_finder import ObjectFinder
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
        """Find all objects of some categories in a photo (H, W, 3), RGB in [0, 1], by decreasing score.

        It finds no objects of categories other than kfit's own. If no object is probable, the likeliest one may be
        returned, with a score below 0.5.
        """
        boxes, scores, certainty = self.candidates(image)
        categories = [name for name in categories if name in NAMES]
        if not categories:
            return []
        wanted = [NAMES.index(name) for name in categories]
        shares = self.probabilities(image, boxes, scores)[:, wanted]
        best = shares.max(1, initial=0)
        rank = best * certainty
        for probable, detected in ((PROBABLE, COVERED), (GUESS, GUESS_COVERED)):
            found: list[FoundObject] = []
            least = max(detected, LEAST_OF_BEST * float(rank[best >= probable].max(initial=0)))
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
        """Return candidate boxes, the detector's scores, and the probability of any object.

        Returns:
            Boxes (N, 4), left, top, right, bottom; scores (N, 23) of the detector's classes; scores (N,) of any object.
        """
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
        """Return probabilities (N, 7) of the categories and of none of them, in the order of `NAMES`, for boxes.

        Args:
            image: (H, W, 3), RGB in [0, 1].
            boxes: (N, 4) left, top, right, bottom in pixels.
            scores: (N, 23) of the detector; by default the detector is run.
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
        """Return the fraction of a non-empty mask (H, W) that is salient in its box, enlarged by a quarter."""
        left, top, width, height = (round(part) for part in box_of(there))
        across, down = round(SURROUND * width), round(SURROUND * height)
        around = np.s_[max(0, top - down) : top + height + down, max(0, left - across) : left + width + across]
        return float((self._salient.saliency(image[around]) > 0.5)[there[around]].mean())

    def _cut_out(
        self, image: NDArray[np.float32], corners: NDArray[Any], category: str, score: float
    ) -> FoundObject | None:
        """Segment the object in an inexact box of the detector; None if the salient region there is another object."""
        reach = SLACK * np.tile(corners[2:] - corners[:2], 2) * (-1, -1, 1, 1)
        left, top, right, bottom = (corners + reach).tolist()
        try:
            segment = self._salient(image, category, (left, top, right - left, bottom - top))
        except ValueError:  # nothing is salient
            return None
        box = box_of(segment.mask)
        if iou(corners[None], _corners(box)[None]).item() < AGREES:
            return None
        return FoundObject(category, score, box, segment)


def _is_new(corners: NDArray[Any], category: str, found: Sequence[FoundObject]) -> bool:
    """Return whether a box holds another object than those already found."""
    for other in found:
        mine, theirs = corners[None], _corners(other.box)[None]
        low, high = np.maximum(mine[:, :2], theirs[:, :2]), np.minimum(mine[:, 2:], theirs[:, 2:])
        smaller = min(float((box[:, 2:] - box[:, :2]).prod()) for box in (mine, theirs))
        inside = float((high - low).clip(0).prod()) / max(smaller, 1.0)
        if iou(mine, theirs).item() > SAME or (other.category == category and inside > INSIDE):
            return False
    return True


def box_of(mask: NDArray[Any]) -> Box:
    """Return left, top, width and height of a mask's box."""
    left, top, width, height = cv2.boundingRect((np.asarray(mask) > 0.5).astype(np.uint8))
    return float(left), float(top), float(width), float(height)


def _corners(box: Box) -> NDArray[np.float64]:
    return np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]])


@lru_cache
def _classifier() -> CategoryClassifier:
    return CategoryClassifier()
