"""Pictures that tell nothing end in an answer that says so."""

from __future__ import annotations

import numpy as np
import pytest

import kfit

SQUARE = np.zeros((60, 80), np.float32)
SQUARE[15:45, 25:55] = 1


@pytest.mark.parametrize("category", ["mug", "can"])
@pytest.mark.parametrize(("colour", "mask"), [(1.0, SQUARE), (0.0, SQUARE), (0.5, SQUARE), (0.0, np.ones_like(SQUARE))])
def test_a_picture_of_one_colour_is_answered_without_confidence(category: str, colour: float, mask: np.ndarray) -> None:
    answer = kfit.load(category).pose(np.full((60, 80, 3), colour, np.float32), mask=mask)
    assert answer.confidence <= 0.5
    assert any(note.startswith("the object shows one colour") for note in answer.notes)
    assert np.isfinite(answer.rotation).all()
    assert np.isfinite(answer.translation).all()


def test_colours_that_differ_a_little_are_not_called_one() -> None:
    rng = np.random.default_rng(0)
    answer = kfit.load("mug").pose(rng.uniform(0.4, 0.6, (60, 80, 3)).astype(np.float32), mask=SQUARE)
    assert not any(note.startswith("the object shows one colour") for note in answer.notes)
