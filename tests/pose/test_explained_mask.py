"""A mask that takes something else along is tried without it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage.data import coffee

import kfit
from kfit.geometry import rotation_error
from kfit.segmentation import mask_from_file


@pytest.mark.slow
def test_the_spoon_next_to_the_coffee_cup_is_left_out() -> None:
    photo = coffee()
    [cup] = kfit.find_poses(photo)
    by_hand = kfit.load("mug").pose(photo, mask=mask_from_file("examples/coffee_mask.png", photo.shape[:2]))
    apart = rotation_error(torch.from_numpy(cup.rotation), torch.from_numpy(by_hand.rotation)).rad2deg()
    assert float(apart) < 20
    assert cup.confidence <= 0.5
    assert any(note.startswith("a part that sticks out of the mask") for note in cup.notes)


@pytest.mark.slow
def test_a_given_mask_is_never_changed() -> None:
    photo = coffee()
    mask = np.asarray(mask_from_file("examples/coffee_mask.png", photo.shape[:2]))
    mask[290:310, 300:420] = 1  # a bar next to the cup
    [cup] = kfit.find_poses(photo, mask=mask)
    np.testing.assert_array_equal(cup.mask > 0.5, mask > 0.5)
