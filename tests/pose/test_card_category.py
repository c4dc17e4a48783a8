"""A model's card tells all of its category, and older cards are filled in."""

import json
from pathlib import Path

import pytest
from tiny_model import tiny_card

from kfit.geometry import CATEGORIES, Category
from kfit.pose import Card

OWN = Category("teapot", 0.28, "y3", axes="y up, spout towards +x", mirror=False, shapes="teapots")


def own_card():
    card = tiny_card()
    return Card("teapot", card.networks, 4.0, **Card.fields_of(OWN))


def test_a_card_holds_a_category_that_kfit_does_not_know():
    again = Card.of_json(own_card().to_json(), Path("own.safetensors"))
    assert again.known == OWN
    assert again.known.nocs_id is None


def test_cards_from_before_are_filled_in_from_kfit_s_own_categories():
    saved = json.loads(tiny_card("bottle").to_json())
    for name in ("diagonals", "sides", "upright", "mirror", "shapes"):
        del saved[name]
    assert Card.of_json(json.dumps(saved), Path("old.safetensors")).known.size_range == (0.1, 0.6)
    assert Card.of_json(json.dumps(saved), Path("old.safetensors")).known.shapes == "kfit.data.shapes.bottle"


def test_an_older_card_of_an_unknown_category_is_refused():
    saved = json.loads(own_card().to_json())
    del saved["sides"]
    with pytest.raises(ValueError, match=r"own\.safetensors holds no model card of format 1"):
        Card.of_json(json.dumps(saved), Path("own.safetensors"))


def test_the_bundled_cards_tell_kfit_s_own_categories():
    assert tiny_card().known == Category("mug", **Card.fields_of(CATEGORIES["mug"]) | {"unit_fraction": 1.0}, nocs_id=6)
