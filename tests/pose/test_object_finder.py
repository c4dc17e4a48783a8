import numpy as np
import pytest
from skimage.data import cat, coffee

from kfit.geometry import CATEGORIES
from kfit.pose.object_finder import ObjectFinder, _is_new, box_of
from kfit.segmentation.object_detector import iou

CUP = np.array([[172.0, 18.0, 403.0, 306.0]])


@pytest.fixture(scope="module")
def finder() -> ObjectFinder:
    return ObjectFinder()


def test_the_cup_of_coffee_is_found_once_and_cut_out(finder: ObjectFinder) -> None:
    (cup,) = finder.find(coffee().astype(np.float32) / 255)
    assert cup.category == "mug"
    assert cup.score > 0.8
    assert cup.box == box_of(cup.segment.mask)
    left, top, width, height = cup.box
    assert iou(np.array([[left, top, left + width, top + height]]), CUP).item() > 0.8


def test_a_cat_is_nothing(finder: ObjectFinder) -> None:
    assert finder.find(cat().astype(np.float32) / 255) == []


def test_an_even_picture_holds_nothing(finder: ObjectFinder) -> None:
    assert finder.find(np.full((90, 120, 3), 0.5, np.float32)) == []


def test_one_category_is_looked_for_alone(finder: ObjectFinder) -> None:
    found = finder.find(coffee().astype(np.float32) / 255, ("laptop",))
    assert all(one.category == "laptop" and one.score < 0.5 for one in found)


def test_probabilities_are_of_six_categories_and_none(finder: ObjectFinder) -> None:
    shares = finder.probabilities(coffee().astype(np.float32) / 255, CUP)
    assert shares.shape == (1, len(CATEGORIES) + 1)
    assert shares.sum() == pytest.approx(1)
    assert finder.probabilities(coffee().astype(np.float32) / 255, np.zeros((0, 4))).shape == (0, 7)


def test_what_of_a_mask_stands_out_is_a_share(finder: ObjectFinder) -> None:
    image = np.full((400, 600, 3), 0.5, np.float32)
    image[150:250, 220:370] = coffee()[::4, ::4] / np.float32(255)
    cup, most = np.zeros((400, 600), bool), np.zeros((400, 600), bool)
    cup[165:210, 270:315] = True
    most[20:380, 100:500] = True
    assert finder.salient_share(image, cup) > 0.6
    assert finder.salient_share(image, most) < 0.3


def test_a_box_on_another_is_the_same_object_and_one_of_another_kind_inside_is_not(finder: ObjectFinder) -> None:
    (cup,) = finder.find(coffee().astype(np.float32) / 255)
    left, top, width, height = cup.box
    inside = np.array([left + 20, top + 20, left + 0.4 * width, top + 0.4 * height])
    assert not _is_new(np.array([left, top, left + width, top + height]) + 5, "bowl", [cup])
    assert not _is_new(inside, "mug", [cup])
    assert _is_new(inside, "can", [cup])
    assert _is_new(np.array([0.0, 0.0, 50.0, 50.0]), "mug", [cup])
