import pytest

from kfit.geometry import CATEGORIES
from kfit.segmentation.classes import COCO, COCO_BY_OWN_NUMBER, SYNONYMS, category_of


@pytest.mark.parametrize(
    ("name", "category"),
    [
        ("cup", "mug"),
        ("Mug", "mug"),
        ("can/tin can", "can"),
        ("laptop computer/notebook computer", "laptop"),
        ("laptop_computer", "laptop"),
        ("wine glass", None),
        ("cupboard", None),
        ("", None),
    ],
)
def test_a_class_is_the_category_that_its_name_says(name: str, category: str | None) -> None:
    assert category_of(name) == category


def test_every_category_is_itself() -> None:
    assert set(SYNONYMS) == set(CATEGORIES)
    assert all(category_of(name) == name for name in CATEGORIES)


def test_of_cocos_classes_four_are_kfits() -> None:
    assert [name for name in COCO if category_of(name)] == ["bottle", "cup", "bowl", "laptop"]


def test_cocos_own_numbers_have_its_gaps() -> None:
    # From the published instances_val2017.json.
    known = {1: "person", 13: "stop sign", 44: "bottle", 47: "cup", 51: "bowl", 73: "laptop", 90: "toothbrush"}
    assert {number: COCO_BY_OWN_NUMBER[number] for number in known} == known
    assert len(COCO_BY_OWN_NUMBER) == len(COCO) == 80
