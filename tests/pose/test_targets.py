from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from kfit.features.category_classifier import NAMES
from kfit.pose.object_finder import FoundObject, box_of
from kfit.pose.targets import find_targets, smaller_targets, with_score
from kfit.segmentation import Detections, Detector, Photo, Segment

SIZE = (100, 120)


def mask_at(left: int, top: int, width: int, height: int) -> np.ndarray:
    mask = np.zeros(SIZE, np.float32)
    mask[top : top + height, left : left + width] = 1
    return mask


def one(category: str, mask: np.ndarray, score: float = 0.9) -> FoundObject:
    return FoundObject(category, score, box_of(mask), Segment(mask))


@dataclass
class Finder:
    """Finds what it is told, and takes everything for what it is told."""

    found: list[FoundObject] = field(default_factory=list)
    shares: dict[str, float] = field(default_factory=lambda: {"mug": 0.9, "none": 0.1})
    salient: float = 1.0

    def find(self, image: Any, categories: Any = NAMES) -> list[FoundObject]:
        return [one for one in self.found if one.category in categories]

    def probabilities(self, image: Any, boxes: Any, scores: Any = None) -> np.ndarray:
        return np.array([[self.shares.get(name, 0.0) for name in NAMES]] * len(boxes))

    def salient_share(self, image: Any, there: Any) -> float:
        return self.salient


PHOTO = Photo(np.random.default_rng(0).random((*SIZE, 3), np.float32))
LEFT, RIGHT = mask_at(10, 20, 30, 40), mask_at(70, 20, 30, 40)


def test_with_nothing_given_all_are_found_and_a_category_narrows() -> None:
    finder: Any = Finder([one("mug", LEFT), one("can", RIGHT)])
    assert [target.category for target in find_targets(PHOTO, finder=finder)] == ["mug", "can"]
    assert [target.category for target in find_targets(PHOTO, "can", finder=finder)] == ["can"]
    assert find_targets(PHOTO, finder=Finder()) == []  # type: ignore[arg-type]


def test_a_mask_or_alpha_channel_tells_the_one_object_and_its_look_the_category() -> None:
    finder: Any = Finder([one("can", RIGHT)])
    for photo, mask in ((PHOTO, LEFT * 255), (Photo(PHOTO.image, LEFT), None)):
        (target,) = find_targets(photo, mask=mask, finder=finder)
        assert target.category == "mug"
        assert target.score == pytest.approx(0.9)
        assert target.box == (10, 20, 30, 40)
        np.testing.assert_array_equal(target.segment.mask, LEFT)


def test_only_a_mask_of_a_person_or_file_is_one_that_nothing_may_change() -> None:
    finder: Any = Finder([one("mug", LEFT)])
    assert [target.chosen for target in find_targets(PHOTO, mask=LEFT, finder=finder)] == [True]
    assert [target.chosen for target in find_targets(Photo(PHOTO.image, LEFT), finder=finder)] == [True]
    assert [target.chosen for target in find_targets(PHOTO, finder=finder)] == [False]


def test_an_object_without_a_part_that_sticks_out_is_doubted() -> None:
    mask = mask_at(10, 20, 40, 40) + mask_at(50, 35, 30, 10)
    [smaller] = smaller_targets(one("mug", mask))
    assert smaller.box == pytest.approx((10, 20, 40, 40), abs=2)
    assert smaller.segment.warnings[0].startswith("a part that sticks out of the mask, 1")
    assert smaller_targets(one("mug", LEFT)) == []


def test_a_named_category_is_believed_more_than_the_picture_alone_would() -> None:
    finder: Any = Finder(shares={"mug": 0.5, "can": 0.4, "none": 0.1})
    (target,) = find_targets(PHOTO, "can", LEFT, finder=finder)
    assert target.category == "can"
    assert target.score == pytest.approx(4 * 0.4 / (4 * 0.4 + 0.6))


def test_a_mask_of_two_objects_or_of_background_is_doubted() -> None:
    both = mask_at(10, 20, 90, 40)
    two: Any = Finder([one("mug", LEFT), one("can", RIGHT)])
    (target,) = find_targets(PHOTO, mask=both, finder=two)
    assert target.segment.warnings == ("the mask seems to show 2 objects; the confidence is 50 % at most",)
    (target,) = find_targets(PHOTO, mask=LEFT, finder=two)
    assert target.segment.warnings == ()
    (target,) = find_targets(PHOTO, mask=LEFT, finder=Finder(salient=0.1))  # type: ignore[arg-type]
    assert "background" in target.segment.warnings[0]


class OwnDetector(Detector):
    classes = ("cup", "can", "dog")

    def detect(self, image: np.ndarray) -> Detections:
        boxes = np.array([[10, 20, 40, 60], [70, 20, 100, 60], [0, 0, 9, 9]], float)
        return Detections(SIZE, boxes, np.array([0.6, 0.8, 0.9]), ["cup", "can", "dog"], np.ones((3, 4, 4)), boxes)


def test_a_detector_of_ones_own_tells_all_objects_of_the_categories() -> None:
    found = find_targets(PHOTO, segmenter=OwnDetector(), finder=Finder())  # type: ignore[arg-type]
    assert [(target.category, target.score) for target in found] == [("can", 0.8), ("mug", 0.6)]
    np.testing.assert_array_equal(found[1].segment.mask, LEFT)


@dataclass(frozen=True)
class Answer:
    confidence: float
    notes: list[str]
    category_score: float | None = None


@pytest.mark.parametrize(
    ("score", "note"),
    [
        (0.04, "this is probably no mug: by its look that has a probability of 4 %, which the confidence includes"),
        (0.6, "by its look this is a mug with a probability of 60 %, which the confidence includes"),
    ],
)
def test_an_improbable_category_lowers_the_confidence_and_says_so(score: float, note: str) -> None:
    doubted: Any = with_score(Answer(0.95, ["cut off"]), one("mug", LEFT, score))  # type: ignore[arg-type]
    assert doubted == Answer(score * 0.95, ["cut off", note], score)


def test_a_probable_category_lowers_the_confidence_by_what_is_left_open() -> None:
    certain: Any = with_score(Answer(0.95, []), one("mug", LEFT, 0.9))  # type: ignore[arg-type]
    assert certain == Answer(0.9 * 0.95, [], 0.9)
