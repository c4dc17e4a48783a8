import pytest

from kfit.cli.category_names import NAMES, named_category
from kfit.geometry import CATEGORIES


@pytest.mark.parametrize(
    ("name", "category"),
    [("mug", "mug"), ("cup", "mug"), ("Coffee-Cups", "mug"), ("tin", "can"), ("wine_bottle", "bottle"),
     ("Notebook", "laptop"), ("bowls", "bowl"), ("digital  camera", "camera")],
)  # fmt: skip
def test_people_may_say_it_in_other_words(name: str, category: str) -> None:
    assert named_category(name) == category


def test_an_unknown_word_lists_those_that_are_known() -> None:
    with pytest.raises(ValueError, match=r"'teapot' is not known; those known are bottle \(or flask, .*mug \(or"):
        named_category("teapot")


def test_a_misspelt_word_names_the_one_that_may_be_meant() -> None:
    with pytest.raises(ValueError, match=r"'mgu' is not known; .*; did you mean mug\?$"):
        named_category("mgu")
    with pytest.raises(ValueError, match=r"teacup\)$"):
        named_category("zebra")


def test_every_category_has_names() -> None:
    assert list(NAMES) == list(CATEGORIES)
