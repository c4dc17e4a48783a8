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


def observed(mask=MASK, **args):
    return ObservedObject.of(PHOTO, CATEGORIES["mug"], 32, mask, **{"intrinsics": CAMERA, **args})


def test_a_stray_pixel_changes_nothing_but_the_notes():
    stray = MASK.copy()
    stray[5, 150] = 1
    clean, noted = observed(), observed(stray)
    assert torch.equal(noted.observation.field("image"), clean.observation.field("image"))
    assert noted.crop == clean.crop
    assert clean.notes == ()
    assert "left out: 1" in noted.notes[0]
    assert not noted.doubtful


def test_a_soft_mask_is_cut_at_one_half():
    soft = np.where(MASK > 0, MASK, 0.4)
    assert observed(soft).crop == observed().crop
    assert observed((255 * soft).astype(np.uint8)).crop == observed().crop


def test_depth_in_millimetres_is_refused_with_its_unit():
    with pytest.raises(ValueError, match=r"depth makes the mug .* is its unit wrong \(millimetres read as metres"):
        observed(depth=1000 * DEPTH)


def test_half_a_mask_of_background_depth_is_doubted():
    depth = DEPTH.copy()
    depth[60:] = 2.0
    found = observed(depth=depth)
    assert found.doubtful
    assert "does the mask cover the background" in found.notes[-1]
    known = found.observation.field("depth")
    assert float(known[known.isfinite()].max()) < 0.8


def test_intrinsics_of_a_picture_of_half_the_size_are_doubted():
    found = observed(intrinsics=CAMERA * [[0.5], [0.5], [1]])
    assert found.doubtful
    assert "is the middle of a picture of" in found.notes[0]


def test_depths_far_in_front_of_the_others_are_left_out():
    depth = DEPTH.copy()
    depth[40:43] = 0.1
    found = observed(depth=depth)
    assert not found.doubtful
    assert "are taken for unknown" in found.notes[0]


def ignored():
    hidden = np.zeros(MASK.shape, np.float32)
    hidden[40:80, 70:120] = 1
    return hidden


def test_ignored_pixels_are_no_object_and_have_no_weight():
    found = observed(ignore=ignored())
    assert found.crop == observed(MASK * (1 - ignored())).crop
    weight, mask = found.observation.field("weight"), found.observation.field("mask")
    assert set(weight.unique().tolist()) == {0.0, 1.0}
    assert float(mask[weight == 0].max()) < 0.3
    outside = found.crop.image_to_crop @ torch.tensor([40.0, 60.0, 1.0], dtype=torch.float64)
    x, y = outside[:2].round().long().clamp(0, 31)
    assert weight[0, 0, y, x] == 1


def test_nothing_ignored_is_no_weight():
    assert observed(ignore=0 * MASK).observation.weight is None


@pytest.mark.parametrize(
    ("ignore", "message"),
    [
        (MASK, "ignore covers all of the object: nothing is left to fit"),
        (MASK[1:], r"ignore must have the photo's shape \(120, 160\), got \(119, 160\)"),
        (np.array([["a"]]), "ignore must be an array of numbers"),
    ],
)
def test_what_ignores_all_or_has_another_shape_is_refused(ignore, message):
    with pytest.raises(ValueError, match=message):
        observed(ignore=ignore)
