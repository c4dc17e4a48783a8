"""What a photo's mask, depth and camera are checked for before a fit."""

import numpy as np
import pytest
import torch

from kfit.geometry import CATEGORIES
from kfit.pose.observed_object import ObservedObject

PHOTO = np.random.default_rng(0).random((120, 160, 3), np.float32)
MASK = np.zeros((120, 160), np.float32)
MASK[40:80, 50:90] = 1
CAMERA = np.array([[200.0, 0, 79.5], [0, 200, 59.5], [0, 0, 1]])
DEPTH = np.full(MASK.shape, 0.7, np.float32)


def seen(mask=MASK, **given):
    return ObservedObject.of(PHOTO, CATEGORIES["mug"], 32, mask, **{"intrinsics": CAMERA, **given})


def test_a_stray_pixel_changes_nothing_but_the_notes():
    stray = MASK.copy()
    stray[5, 150] = 1
    clean, noted = seen(), seen(stray)
    assert torch.equal(noted.observation.field("image"), clean.observation.field("image"))
    assert noted.crop == clean.crop
    assert clean.notes == ()
    assert "left out: 1" in noted.notes[0]
    assert not noted.doubtful


def test_a_soft_mask_is_cut_at_one_half():
    soft = np.where(MASK > 0, MASK, 0.4)
    assert seen(soft).crop == seen().crop
    assert seen((255 * soft).astype(np.uint8)).crop == seen().crop


def test_depth_in_millimetres_is_refused_with_its_unit():
    with pytest.raises(ValueError, match=r"depth makes the mug .* is its unit wrong \(millimetres read as metres"):
        seen(depth=1000 * DEPTH)


def test_half_a_mask_of_background_depth_is_doubted():
    depth = DEPTH.copy()
    depth[60:] = 2.0
    found = seen(depth=depth)
    assert found.doubtful
    assert "does the mask cover the background" in found.notes[-1]
    known = found.observation.field("depth")
    assert float(known[known.isfinite()].max()) < 0.8


def test_intrinsics_of_a_picture_of_half_the_size_are_doubted():
    found = seen(intrinsics=CAMERA * [[0.5], [0.5], [1]])
    assert found.doubtful
    assert "is the middle of a picture of" in found.notes[0]


def test_depths_far_in_front_of_the_others_are_left_out():
    depth = DEPTH.copy()
    depth[40:43] = 0.1
    found = seen(depth=depth)
    assert not found.doubtful
    assert "are taken for unknown" in found.notes[0]
