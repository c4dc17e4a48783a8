"""What a photo's answer is about: each object with its category, how sure that is, and what tells its mask."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.features.category_classifier import NAMES
from kfit.geometry import CATEGORIES
from kfit.pose.inputs import choose_mask
from kfit.pose.object_finder import FoundObject, ObjectFinder, box_of
from kfit.pose.result import PoseResult
from kfit.segmentation import Box, Detector, Photo, Segment, Segmenter, mask_from_alpha

# The odds that an object is of the category that a person names, over those that its picture tells.
NAMED = 4.0
# Below the first probability of its category an answer says that it is probably another thing, below the second how
# probable the category is.
PROBABLE, CLEAR = 0.5, 0.8
# An object lies in a mask by this share of its own, and is one of several if it has between these shares of the mask.
INSIDE, LEAST_PART = 0.7, 0.15
# Least share of a mask that stands out from its surroundings.
SALIENT = 0.3


def find_targets(
    photo: Photo,
    category: str | None = None,
    mask: NDArray[Any] | None = None,
    box: Box | None = None,
    segmenter: Segmenter | None = None,
    finder: ObjectFinder | None = None,
) -> list[FoundObject]:
    """Find the objects that an answer is about.

    A mask, a box or an alpha channel tells one object; a detector tells all that it knows; with nothing given, the
    finder looks for all six categories. A category narrows what is looked for, and holds for the object in a box.

    Args:
        photo: to look at.
        category: one of `kfit.geometry.CATEGORIES`.
        mask: (H, W), above one half of its full scale on the object.
        box: left, top, width, height in pixels.
        segmenter: of the object's mask, instead of kfit's own networks.
        finder: to use.

    Returns:
        None or more, those seen best first.

    Raises:
        ValueError: for a mask or box that cannot be used, or no object where one was pointed at.
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
        segment = replace(segment, doubts=segment.doubts + _doubts(finder, photo, segment.mask))
    return [_classified(finder, photo, segment, category)]


def with_score(result: PoseResult, target: FoundObject) -> PoseResult:
    """The answer with the probability that its object is of the category, by which its confidence is multiplied.

    A pose can be right only if the category is.
    """
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


def _detected(photo: Photo, detector: Detector) -> list[FoundObject]:
    """What a detector finds of kfit's categories; its own scores tell how sure it is."""
    detections = detector.detect(photo.image)
    found = []
    for index in np.argsort(-detections.scores, kind="stable").tolist():
        category, mask = detections.categories[index], detections.mask(index)
        if category is not None and mask.any():
            found.append(FoundObject(category, float(detections.scores[index]), box_of(mask), Segment(mask)))
    return found


def _doubts(finder: ObjectFinder, photo: Photo, mask: NDArray[np.float32]) -> tuple[str, ...]:
    """Sentences where a given mask shows several objects, or little that stands out from around it."""
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
    """The object of a mask, as a category that was named or the likeliest one."""
    left, top, width, height = box = box_of(segment.mask)
    corners = np.array([[left, top, left + width, top + height]])
    shares = finder.probabilities(photo.image, corners)[0]
    if category is None:
        best = int(shares[: len(CATEGORIES)].argmax())
        return FoundObject(NAMES[best], float(shares[best]), box, segment)
    share = float(shares[NAMES.index(category)])
    return FoundObject(category, NAMED * share / (NAMED * share + 1 - share), box, segment)
