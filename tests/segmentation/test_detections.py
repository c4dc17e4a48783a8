import numpy as np
import pytest
from skimage.transform import resize

from kfit.segmentation import Detections, Segmenter

IMAGE = np.zeros((40, 60, 3), np.float32)
BOXES = np.array([[0, 0, 20, 20], [30, 10, 50, 30], [30, 10, 44, 30], [0, 20, 10, 40]], float)


def detections(names: list[str], scores: list[float]) -> Detections:
    count = len(names)
    masks = np.ones((count, 1, 1), bool)
    return Detections((40, 60), BOXES[:count], np.array(scores), names, masks, BOXES[:count])


def test_without_a_box_the_best_of_the_category_is_used_and_others_are_reported() -> None:
    found = detections(["cup", "coffee_cup", "bowl"], [0.6, 0.8, 0.9])
    assert isinstance(found, Segmenter)
    assert found.categories == ["mug", "mug", "bowl"]
    segment = found(IMAGE, "mug")
    expected = np.zeros((40, 60), np.float32)
    expected[10:30, 30:50] = 1
    np.testing.assert_array_equal(segment.mask, expected)
    assert segment.mask.dtype == np.float32
    assert segment.notes == (
        "the surest of 2 detections was taken, 'coffee_cup' (80 %, box 30 10 20 20), and not "
        "'cup' (60 %, box 0 0 20 20)",
    )
    assert found(IMAGE, "bowl").notes == ()


def test_in_a_box_the_best_fit_is_taken_whatever_its_class_and_score() -> None:
    found = detections(["cup", "cup", "bottle"], [0.6, 0.8, 0.3])
    segment = found(IMAGE, "can", (30, 10, 14, 20))
    assert segment.mask.sum() == 14 * 20
    assert "takes the object in the box for another than a can: 'bottle' (30 %" in segment.notes[0]
    assert found(IMAGE, "mug", (29, 11, 20, 20)).notes == ()


@pytest.mark.parametrize(
    ("names", "category", "box", "sentence"),
    [
        (["bowl"], "mug", None, r"no mug was detected in the photo, but 'bowl' \(50 %, box 0 0 20 20\)"),
        ([], "mug", None, "no mug was detected in the photo, but nothing at all"),
        ([], "mug", (1, 1, 9, 9), r"no detection fills box \(1, 1, 9, 9\)$"),
        (["cup"], "mug", (15, 15, 20, 20), r"no detection fills box \(15, 15, 20, 20\); nearest is 'cup'"),
        (["cup"], "mug", (70, 15, 20, 20), "lies outside the picture of 60 x 40 pixels"),
    ],
)
def test_what_is_not_found_is_reported_in_a_sentence(
    names: list[str], category: str, box: tuple[float, float, float, float] | None, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        detections(names, [0.5] * len(names))(IMAGE, category, box)


def test_a_mask_of_another_photo_or_without_pixels_is_refused() -> None:
    with pytest.raises(ValueError, match="of a photo of 60 x 40 pixels, this one has 30 x 40"):
        detections(["cup"], [0.5])(IMAGE[:, :30], "mug")
    empty = Detections((40, 60), BOXES[:1], np.ones(1), ["cup"], np.zeros((1, 4, 4)), BOXES[:1])
    with pytest.raises(ValueError, match=r"the mask of the detected 'cup' \(100 %, box 0 0 20 20\) is empty"):
        empty(IMAGE, "mug")


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"boxes must have shape \(2, 4\) for 2 names, got \(1, 4\)"):
        Detections((4, 4), np.ones((1, 4)), np.ones(2), ["cup", "cup"], np.ones((2, 4, 4)), np.ones((2, 4)))
    with pytest.raises(ValueError, match=r"masks must have shape \(1, h, w\) for 1 names, got \(4, 4\)"):
        Detections((4, 4), np.ones((1, 4)), np.ones(1), ["cup"], np.ones((4, 4)), np.ones((1, 4)))


def test_a_mask_is_scaled_as_scikit_image_scales_it_and_ends_at_its_box() -> None:
    soft = np.random.default_rng(0).random((1, 5, 7)).astype(np.float32)
    frame = np.array([[4, 8, 39, 33]], float)  # 35 x 25 pixels: five a cell
    found = Detections((40, 60), np.array([[10.0, 8, 39, 33]]), np.ones(1), ["cup"], soft, frame)
    expected = np.zeros((40, 60))
    expected[8:33, 4:39] = resize(soft[0], (25, 35), order=1, mode="edge")
    expected[:, :10] = 0
    certain = np.abs(expected - 0.5) > 1e-3
    np.testing.assert_array_equal(found.mask(0)[certain], (expected > 0.5)[certain])


def test_a_box_beyond_the_photo_is_cut_off() -> None:
    box = np.array([[-10.0, 30, 10, 50]])
    found = Detections((40, 60), box, np.ones(1), ["cup"], np.ones((1, 28, 28)), box)
    assert found.mask(0).sum() == 10 * 10
    away = box + 100
    assert not Detections((40, 60), away, np.ones(1), ["cup"], np.ones((1, 28, 28)), away).mask(0).any()
