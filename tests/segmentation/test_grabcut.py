import cv2
import numpy as np
import pytest
from skimage.data import coffee

from kfit.segmentation import mask_from_box

Box = tuple[float, float, float, float]


def scene(width: int = 200, height: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """A blue disc with a small glint, on noisy ochre ground."""
    rng = np.random.default_rng(0)
    image = np.full((height, width, 3), (0.7, 0.5, 0.2)) + rng.normal(0, 0.05, (height, width, 3))
    disc = np.zeros((height, width), np.uint8)
    cv2.circle(disc, (90, 70), 35, 1, -1)
    image[disc > 0] = (0.1, 0.2, 0.8)
    image += rng.normal(0, 0.02, image.shape)
    image[60:63, 80:83] = (0.7, 0.5, 0.2)
    return image.clip(0, 1).astype(np.float32), disc


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float(((a > 0) & (b > 0)).sum() / ((a > 0) | (b > 0)).sum())


def test_a_disc_is_found_and_its_glint_filled() -> None:
    image, disc = scene()
    mask = mask_from_box(image, (53, 33, 75, 75))
    assert mask.shape == (150, 200)
    assert mask.dtype == np.float32
    assert set(np.unique(mask)) == {0, 1}
    assert overlap(mask, disc) > 0.97
    assert mask[61, 81] == 1


def test_the_same_box_gives_the_same_mask() -> None:
    image, _ = scene()
    np.testing.assert_array_equal(mask_from_box(image, (50, 30, 80, 80)), mask_from_box(image, (50, 30, 80, 80)))


def test_a_box_partly_outside_is_cut_off() -> None:
    image, disc = scene()
    mask = mask_from_box(image[:, 75:], (-40, 33, 93, 75))
    assert overlap(mask, disc[:, 75:]) > 0.95


def test_a_box_around_the_whole_picture_still_finds_what_is_in_the_middle() -> None:
    image, disc = scene()
    mask = mask_from_box(image[36:104, 56:124], (0, 0, 68, 68))
    assert overlap(mask, disc[36:104, 56:124]) > 0.95


def test_a_large_photo_is_cut_at_reduced_size() -> None:
    image, disc = scene()
    large = cv2.resize(image, None, fx=8, fy=8, interpolation=cv2.INTER_LINEAR)
    mask = mask_from_box(large, (424, 264, 600, 600))
    assert overlap(mask, cv2.resize(disc, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST)) > 0.95


def test_of_two_parts_the_larger_is_kept() -> None:
    image, disc = scene()
    image[100:112, 115:125] = (0.1, 0.2, 0.8)
    mask = mask_from_box(image, (53, 33, 75, 80))
    assert mask[106, 120] == 0
    assert overlap(mask, disc) > 0.95


def test_the_coffee_cup_on_its_saucer_is_found() -> None:
    image = (coffee() / 255).astype(np.float32)
    # The saucer is an ellipse, and the cup stands within it but for its rim.
    expected = np.zeros(image.shape[:2], np.uint8)
    cv2.ellipse(expected, (278, 227), (203, 155), 13, 0, 360, 1, -1)
    cv2.ellipse(expected, (291, 113), (118, 94), 8, 0, 360, 1, -1)
    assert overlap(mask_from_box(image, (76, 14, 406, 374)), expected) > 0.9


@pytest.mark.parametrize(
    ("box", "sentence"),
    [
        ((10, 10, 0, 20), r"box \(10, 10, 0, 20\) \(left, top, width, height\) has no area; the picture has 200 x 150"),
        ((10, 10, 20, -5), r"box \(10, 10, 20, -5\) .* has no area"),
        ((10, 10, float("nan"), 5), r"has no area"),
        ((300, 10, 20, 20), r"box \(300, 10, 20, 20\) .* lies outside the picture of 200 x 150 pixels"),
        ((198, 10, 20, 20), r"leaves less than 4 pixels a side in the picture of 200 x 150 pixels"),
        ((150, 100, 40, 40), r"no object found in box \(150, 100, 40, 40\): nothing stands out"),
    ],
)
def test_a_box_that_holds_nothing_is_refused(box: Box, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        mask_from_box(scene()[0], box)
