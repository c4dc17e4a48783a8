from pathlib import Path

import numpy as np
import pytest
from onnx_files import is_net
from skimage.data import coffee

from kfit.segmentation import object_detector
from kfit.segmentation.object_detector import CLASSES, ObjectDetector, anchors, iou

CUP = np.array([[172.0, 18.0, 403.0, 306.0]])


@pytest.fixture(scope="module")
def detector() -> ObjectDetector:
    return ObjectDetector()


def test_the_cup_of_coffee_gets_the_best_box(detector: ObjectDetector) -> None:
    found = detector(coffee().astype(np.float32) / 255)
    assert iou(found.boxes[:1], CUP).item() > 0.8
    assert CLASSES[int(found.scores[0].argmax())] == "Coffee cup"
    assert found.scores[0, CLASSES.index("Coffee cup")] == pytest.approx(0.56, abs=0.02)


def test_boxes_follow_the_size_of_the_photo(detector: ObjectDetector) -> None:
    image = coffee().astype(np.float32) / 255
    small, large = detector(image), detector(image.repeat(3, 0).repeat(3, 1))
    np.testing.assert_allclose(large.boxes[0], 3 * small.boxes[0], atol=9)


def test_boxes_lie_inside_the_photo_and_apart(detector: ObjectDetector) -> None:
    found = detector(coffee().astype(np.float32) / 255)
    assert (found.boxes >= 0).all()
    assert (found.boxes <= (600, 400, 600, 400)).all()
    overlaps = iou(found.boxes, found.boxes) - np.eye(len(found.boxes))
    assert overlaps.max() < 0.7  # means of boxes overlap a little more than those they stand for


def test_no_boxes_keep_their_shapes(detector: ObjectDetector, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(object_detector, "LEAST_SCORE", 0.99)
    found = detector(np.full((120, 200, 3), 0.5, np.float32))
    assert found.boxes.shape == (0, 4)
    assert found.scores.shape == (0, 23)


def test_anchors_are_those_of_tensorflow() -> None:
    # object_detection.anchor_generators.multiple_grid_anchor_generator.create_ssd_anchors(6, 0.2, 0.95,
    # reduce_boxes_in_lowest_layer=True): its boxes (y, x, y, x) of the first cell, of grid 10's first, and of the last.
    found = anchors()
    assert found.shape == (1917, 4)
    centre = 0.5 / 19
    np.testing.assert_allclose(found[0], [centre, centre, 0.1, 0.1])
    np.testing.assert_allclose(found[1], [centre, centre, 0.2 / 2**0.5, 0.2 * 2**0.5])
    np.testing.assert_allclose(found[2], [centre, centre, 0.2 * 2**0.5, 0.2 / 2**0.5])
    np.testing.assert_allclose(found[3 * 19**2], [0.05, 0.05, 0.35, 0.35])
    np.testing.assert_allclose(found[3 * 19**2 + 5], [0.05, 0.05, 0.175**0.5, 0.175**0.5])
    np.testing.assert_allclose(found[-1], [0.5, 0.5, 0.95**0.5, 0.95**0.5])


def test_another_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.onnx has not the layout of kfit's object detector"):
        ObjectDetector(is_net(tmp_path / "a.onnx"))
