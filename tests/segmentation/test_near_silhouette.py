"""Masks found about the outline of a drawing."""

import numpy as np
import pytest

from kfit.segmentation import mask_near

SIDE = 64
ROWS, COLUMNS = np.mgrid[:SIDE, :SIDE]


def disc(x, y, radius):
    return ((COLUMNS - x) ** 2 + (ROWS - y) ** 2 < radius**2).astype(np.float32)


def picture(mask):
    noise = np.random.default_rng(0).normal(0, 0.02, (SIDE, SIDE, 3))
    colours = mask[..., None] * np.array([0.8, 0.2, 0.2]) + (1 - mask[..., None]) * np.array([0.2, 0.4, 0.7])
    return np.clip(colours + noise, 0, 1).astype(np.float32)


@pytest.mark.parametrize("shift", [0, 2, -4])
def test_an_object_that_moved_less_than_the_band_is_found(shift):
    truth = disc(32 + shift, 30, 14)
    found = mask_near(picture(truth), disc(32, 30, 14), band=5)
    assert (found * truth).sum() / np.maximum(found, truth).sum() > 0.98


def test_nothing_farther_than_the_band_is_taken():
    other = disc(54, 54, 6)
    found = mask_near(picture(np.maximum(disc(28, 28, 12), other)), disc(28, 28, 12), band=5)
    assert (found * other).sum() == 0


@pytest.mark.parametrize("silhouette", [np.zeros((SIDE, SIDE)), np.ones((SIDE, SIDE))])
def test_a_silhouette_of_nothing_or_of_all_tells_nothing(silhouette):
    assert mask_near(picture(disc(32, 32, 10)), silhouette.astype(np.float32), band=5) is None


def test_what_is_much_larger_than_the_silhouette_is_something_else():
    assert mask_near(picture(disc(32, 32, 18)), disc(32, 32, 10), band=9) is None
