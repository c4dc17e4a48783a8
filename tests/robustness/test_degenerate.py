"""Pictures that tell nothing end in an answer that says so."""

from __future__ import annotations

import numpy as np
import pytest

import kfit
from kfit.geometry import CATEGORIES

SQUARE = np.zeros((60, 80), np.float32)
SQUARE[15:45, 25:55] = 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("category", "colour", "mask"),
    [("mug", 1.0, SQUARE), ("can", 0.0, SQUARE), ("mug", 0.5, SQUARE), ("can", 0.0, np.ones_like(SQUARE))],
)
def test_a_picture_of_one_colour_is_answered_without_confidence(category: str, colour: float, mask: np.ndarray) -> None:
    answer = kfit.load(category).pose(np.full((60, 80, 3), colour, np.float32), mask=mask)
    assert answer.confidence <= 0.5
    assert any(note.startswith("the object has one colour") for note in answer.notes)
    assert np.isfinite(answer.rotation).all()
    assert np.isfinite(answer.translation).all()


@pytest.mark.slow
def test_colours_that_differ_a_little_are_not_called_one() -> None:
    rng = np.random.default_rng(0)
    answer = kfit.load("mug").pose(rng.uniform(0.4, 0.6, (60, 80, 3)).astype(np.float32), mask=SQUARE)
    assert not any(note.startswith("the object has one colour") for note in answer.notes)


YY, XX = np.mgrid[:60, :80]
PHOTOS = {
    "noise": np.random.default_rng(0).random((60, 80, 3)),
    "checkerboard": np.repeat(((YY // 8 + XX // 8) % 2)[..., None], 3, 2),
    "white": np.ones((60, 80, 3)),
    "black": np.zeros((60, 80, 3)),
}
MASKS = {name: np.zeros((60, 80), np.float32) for name in ("square", "pixel", "full")}
MASKS["square"][15:45, 25:55] = MASKS["pixel"][30, 40] = MASKS["full"][:] = 1
DEPTHS = {"no depth": None, "flat": np.full((60, 80), 0.6, np.float32), "plane": (0.4 + 0.005 * XX).astype(np.float32)}


PICTURES = [
    ("noise", "square", "no depth"), ("noise", "full", "no depth"), ("noise", "square", "flat"),
    ("checkerboard", "square", "no depth"), ("checkerboard", "square", "plane"), ("black", "pixel", "no depth"),
    ("white", "full", "flat"),
]  # fmt: skip
# Every other pair: each category has three or four of the pictures, each picture three of the categories.
PAIRS = [
    (category, *picture) for number, category in enumerate(sorted(CATEGORIES)) for picture in PICTURES[number % 2 :: 2]
]


@pytest.mark.slow
@pytest.mark.parametrize(("category", "photo", "mask", "depth"), PAIRS)
def test_a_picture_without_an_object_is_answered_without_confidence(category, photo, mask, depth) -> None:
    answer = kfit.load(category).pose(PHOTOS[photo].astype(np.float32), mask=MASKS[mask], depth=DEPTHS[depth])
    assert answer.confidence <= 0.5
    assert np.isfinite([*answer.rotation.flatten(), *answer.translation, *answer.size]).all()
