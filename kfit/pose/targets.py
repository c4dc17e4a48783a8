"""The objects of an answer: category, its probability, and mask of each."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.features.category_classifier import NAMES
from kfit.geometry import CATEGORIES
from kfit.pose.card import Card
from kfit.pose.inputs import choose_mask
from kfit.pose.object_finder import FoundObject, ObjectFinder, box_of
from kfit.pose.result import PoseResult
from kfit.segmentation import Box, Detector, Photo, Segment, Segmenter, mask_from_alpha, without_protrusions

# Factor by which naming a category increases the odds from the picture.
NAMED = 4.0
# Below the first probability of its category an answer notes that it is probably another object, below the second how
# probable the category is.
PROBABLE, CLEAR = 0.5, 0.8
# Fraction of an object inside of a mask that contains it, and least fraction of the mask for one of several objects.
INSIDE, LEAST_PART = 0.7, 0.15
# Least salient fraction of a mask.
SALIENT = 0.3


def find_targets(
    photo: Photo,
    category: str | None = None,
    mask: NDArray[Any] | None = None,
    box: Box | None = None,
    segmenter: Segmenter | None = None,
    finder: ObjectFinder | None = None,
) -> list[FoundObject]:
    """Find the objects to answer for.

    A mask, a box or an alpha channel selects one object; a detector returns all of its objects; otherwise the finder
    searches for all six categories. A category limits the search, and is that of the object in a box.

    Args:
        photo: the photo.
        category: its name; nothing checks one that is none of kfit's own.
        mask: (H, W), above one half of its full scale on the object.
        box: left, top, width, height in pixels.
        segmenter: segmenter that finds the object's mask, instead of kfit's own networks.
        finder: searches for objects.

    Returns:
        Any number of objects, by decreasing score.

    Raises:
        ValueError: if a mask or box cannot be used, or holds no object.
    """
    finder = finder or ObjectFinder()
    alpha = None if photo.alpha is None else mask_from_alpha(photo.alpha)
    if mask is None and box is None and alpha is None:
        if isinstance(segmenter, Detector) and category is None:
            return _detected(photo, segmenter)
        if segmenter is None:
            found = finder.find(photo.image, tuple(CATEGORIES) if category is None else (category,))
            if found or category is None:
                return found
    segment = choose_mask(photo.image, mask, box, alpha, segmenter, category or "object")
    if mask is not None:
        segment = replace(segment, warnings=segment.warnings + _mask_warnings(finder, photo, segment.mask))
    chosen = mask is not None or (alpha is not None and box is None and segmenter is None)
    return [replace(_classified(finder, photo, segment, category), chosen=chosen)]


def with_score(result: PoseResult, target: FoundObject) -> PoseResult:
    """Return the answer with the probability that its object is of the category, an upper bound of its confidence.

    A pose can be right only if the category is. Where nothing checked the category, the answer stays as it is.
    """
    if target.score is None:
        return result
    notes, percent = list(result.notes), f"{100 * target.score:.0f} %"
    if target.score < PROBABLE:
        notes.append(
            f"this is probably no {target.category}: by its look that has a probability of {percent}, which the "
            "confidence includes"
        )
    elif target.score < CLEAR:
        notes.append(
            f"by its look this is a {target.category} with a probability of {percent}, which the confidence includes"
        )
    return replace(result, confidence=target.score * result.confidence, notes=notes, category_score=target.score)


def is_unexplained(card: Card, answer: PoseResult) -> bool:
    """Return whether an answer's energy is above that of 99 % of the views on which its model was calibrated."""
    known = card.calibration.get("RGB")
    return known is not None and answer.calibrated and not known.explains(answer.energy)


def smaller_targets(target: FoundObject) -> list[FoundObject]:
    """Return the object with each of the parts that stick out of its mask left out, with a warning about it."""
    before, found = float((target.segment.mask > 0.5).sum()), []
    for mask in without_protrusions(target.segment.mask):
        share = 1 - float((mask > 0.5).sum()) / before
        warning = (
            f"a part that sticks out of the mask, {100 * share:.0f} % of it, was left out because the drawing explains "
            "the rest much better; the confidence is 50 % at most"
        )
        segment = replace(target.segment, mask=mask, warnings=(*target.segment.warnings, warning))
        found.append(replace(target, box=box_of(mask), segment=segment))
    return found


def _detected(photo: Photo, detector: Detector) -> list[FoundObject]:
    """Return the detections of kfit's categories, with the detector's scores."""
    detections = detector.detect(photo.image)
    found = []
    for index in np.argsort(-detections.scores, kind="stable").tolist():
        category, mask = detections.categories[index], detections.mask(index)
        if category is not None and mask.any():
            found.append(FoundObject(category, float(detections.scores[index]), box_of(mask), Segment(mask)))
    return found


def _mask_warnings(finder: ObjectFinder, photo: Photo, mask: NDArray[np.float32]) -> tuple[str, ...]:
    """Return sentences if a mask covers several objects, or little that is salient."""
    there = mask > 0.5
    parts = [one.segment.mask > 0.5 for one in finder.find(photo.image)]
    within = [part for part in parts if (part & there).sum() > INSIDE * part.sum()]
    several = [part for part in within if LEAST_PART < (part & there).sum() / there.sum() < INSIDE]
    if len(several) > 1:
        return (f"the mask seems to show {len(several)} objects; the confidence is 50 % at most",)
    if finder.salient_share(photo.image, there) < SALIENT:
        return ("the mask seems to show background for the most part; the confidence is 50 % at most",)
    return ()


def _classified(finder: ObjectFinder, photo: Photo, segment: Segment, category: str | None) -> FoundObject:
    """Return the object of a mask, of the named category or the likeliest one."""
    left, top, width, height = box = box_of(segment.mask)
    if category is not None and category not in NAMES:
        return FoundObject(category, None, box, segment)
    corners = np.array([[left, top, left + width, top + height]])
    shares = finder.probabilities(photo.image, corners)[0]
    if category is None:
        best = int(shares[: len(CATEGORIES)].argmax())
        return FoundObject(NAMES[best], float(shares[best]), box, segment)
    share = float(shares[NAMES.index(category)])
    return FoundObject(category, NAMED * share / (NAMED * share + 1 - share), box, segment)
