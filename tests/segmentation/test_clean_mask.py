import numpy as np
import pytest

from kfit.segmentation import binary_mask, clean_mask

MASK = np.zeros((100, 120), np.float32)
MASK[30:70, 40:80] = 1


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64, np.float32, np.float64])
def test_a_mask_of_zeros_and_ones_is_itself_whatever_its_type(kind: type) -> None:
    np.testing.assert_array_equal(binary_mask(MASK.astype(kind)), MASK)


@pytest.mark.parametrize("scale", [1.0, 255, 65535])
def test_the_threshold_is_half_of_the_full_scale(scale: float) -> None:
    values = np.array([[0.0, 0.2, 0.49, 0.51, 0.9, 1]]) * scale
    np.testing.assert_array_equal(binary_mask(values), [[0, 0, 0, 1, 1, 1]])


def test_a_faint_matte_is_empty_and_nan_is_background() -> None:
    assert binary_mask(np.array([[0, 0.3, np.nan]])).sum() == 0


def test_a_stray_pixel_is_dropped_with_a_note() -> None:
    mask = MASK.copy()
    mask[2, 117] = 1
    found = clean_mask(mask)
    np.testing.assert_array_equal(found.mask, MASK)
    assert len(found.notes) == 1
    assert "left out: 1, with 0.062 % of its pixels" in found.notes[0]
    assert found.warnings == ()


def test_speckle_is_dropped_also_at_the_object() -> None:
    mask = MASK.copy()
    specks = np.random.default_rng(0).random(MASK.shape) < 0.001
    specks[28:72, 38:82] = False
    specks[50, 82] = True  # a pixel beside it
    found = clean_mask(np.maximum(mask, specks))
    np.testing.assert_array_equal(found.mask, MASK)


def test_a_part_behind_something_thin_is_kept() -> None:
    mask = MASK.copy()
    mask[:, 70:73] = 0
    found = clean_mask(mask)
    np.testing.assert_array_equal(found.mask, mask)
    assert found.notes == found.warnings == ()


def test_a_second_object_stays_and_is_doubted() -> None:
    mask = MASK.copy()
    mask[30:70, 100:118] = 1
    found = clean_mask(mask)
    np.testing.assert_array_equal(found.mask, mask)
    assert "two objects" in found.warnings[0]
    mask[30:70, 105:118] = 0  # less than a quarter
    np.testing.assert_array_equal(clean_mask(mask).mask, MASK)


def test_soft_borders_stay_with_the_part_that_they_belong_to() -> None:
    mask = MASK.copy()
    mask[29, 40:80] = 0.4
    wanted = mask.copy()
    mask[5, 5], mask[5, 6] = 1, 0.3
    np.testing.assert_array_equal(clean_mask(mask).mask, wanted)


def test_an_empty_mask_stays_empty() -> None:
    assert clean_mask(MASK * 0).mask.sum() == 0


def test_small_holes_are_filled_and_a_handles_is_not() -> None:
    mask = np.zeros((100, 100), np.float32)
    mask[20:80, 20:80] = 1
    mask[30, 30] = mask[50:53, 50:53] = 0
    mask[40:60, 66:76] = 0  # a handle's
    clean = clean_mask(mask).mask
    assert clean[30, 30] == clean[51, 51] == 1
    assert not clean[40:60, 66:76].any()


def test_gaps_at_the_pictures_border_are_no_holes() -> None:
    mask = np.ones((100, 100), np.float32)
    mask[:3, 50:53] = 0
    np.testing.assert_array_equal(clean_mask(mask).mask, mask)
