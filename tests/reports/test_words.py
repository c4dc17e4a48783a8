"""Poses in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted import fitted_mug

from kfit.geometry import CATEGORIES, rotation_from_angles, to_opencv
from kfit.reports import describe
from kfit.reports.words import confidence_level, confidence_words, length, lengths, view_words

STRAIGHT_ON = np.array([0.0, 0.0, 0.5])


def view(azimuth: float, elevation: float, roll: float = 0.0, category: str = "mug") -> str:
    angles = torch.tensor([azimuth, elevation, roll]).double().deg2rad()
    return view_words(CATEGORIES[category].front, to_opencv(rotation_from_angles(*angles)).numpy(), STRAIGHT_ON)


@pytest.mark.parametrize(
    ("azimuth", "words"),
    [
        (-90, "handle towards you"),
        (0, "handle on the right"),
        (90, "handle away from you"),
        (180, "handle on the left"),
        (-113, "handle towards you on the left"),
        (140, "handle away from you on the left"),
    ],
)
def test_the_front_is_where_the_camera_sees_it(azimuth: float, words: str) -> None:
    assert view(azimuth, 53) == f"seen from 53° above, {words}"
    rotation = to_opencv(rotation_from_angles(*torch.tensor([azimuth, 0.0, 0.0]).double().deg2rad()))
    x, _, z = rotation[:, 0].tolist()  # the handle's direction in the camera, which looks along +z
    assert ("on the right" in words) == (x > 0.38)
    assert ("on the left" in words) == (x < -0.38)
    assert ("towards you" in words) == (z < -0.38)


def test_heights_and_leans_are_described_if_there_are_any() -> None:
    assert view(-90, 1) == "seen from the side, handle towards you"
    assert view(-90, -20) == "seen from 20° below, handle towards you"
    assert view(-90, 86) == "seen from straight above, handle towards you"
    assert view(-90, 30, 15) == "seen from 30° above, handle towards you, leaning 15° to the left"
    assert view(-90, 30, 176) == "seen from 30° above, handle towards you, upside down"
    assert view(0, 30, category="bowl") == "seen from 30° above"
    assert view(-90, 30, category="laptop") == "seen from 30° above, screen towards you"


def test_lengths_are_metres_from_a_hundred_centimetres_on() -> None:
    assert [length(metres) for metres in (0.404, 0.994, 0.996, 2.44)] == ["40 cm", "99 cm", "1.0 m", "2.4 m"]
    assert lengths([0.12, 0.08, 0.094]) == "12 × 8 × 9 cm"
    assert lengths([0.12, 0.004]) == "12.0 × 0.4 cm"
    assert lengths([1.2, 0.4]) == "1.2 × 0.4 m"


def test_a_low_confidence_reads_low() -> None:
    assert confidence_words(0.9) == "90 % sure to be within 20°"
    assert confidence_words(0.999) == "99 % sure to be within 20°"
    assert confidence_words(0.7) == "only 70 % sure to be within 20°"
    assert confidence_words(0.9, ambiguous=True) == "only 90 % sure to be within 20°, ambiguous"
    assert confidence_words(0.5) == "unsure, only 50 % likely to be within 20°"
    assert [confidence_level(share) for share in (0.5, 0.51, 0.8)] == ["low", "medium", "high"]


def test_an_answer_is_one_line_and_an_uncalibrated_one_claims_nothing() -> None:
    mug = replace(fitted_mug(), size=np.array([0.12, 0.08, 0.09]), confidence=0.9, calibrated=True, ambiguous=False)
    assert describe(mug).startswith("mug seen from ")
    assert "; 12 × 8 × 9 cm, about " in describe(mug)
    assert describe(mug).endswith(" away; 90 % sure to be within 20°")
    assert "about" not in describe(replace(mug, size_from="depth"))
    assert describe(replace(mug, calibrated=False)).endswith("; confidence not calibrated")
