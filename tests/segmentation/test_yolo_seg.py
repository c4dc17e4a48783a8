from pathlib import Path

import numpy as np
import pytest
from onnx_files import DISC_BOX, OTHER_BOX, overlap, scene, yolo

from kfit.segmentation import YoloSeg, load_segmenter


@pytest.mark.parametrize("suppressed", [False, True])
def test_both_layouts_give_the_same_objects(tmp_path: Path, suppressed: bool) -> None:
    image, disc = scene()
    detector = load_segmenter(yolo(tmp_path / "a.onnx", suppressed=suppressed))
    assert isinstance(detector, YoloSeg)
    found = detector.detect(image)
    assert found.names == ["cup", "bottle", "cup"]
    np.testing.assert_allclose(found.scores, [0.9, 0.6, 0.4], atol=1e-6)
    np.testing.assert_allclose(found.boxes, [DISC_BOX, OTHER_BOX, OTHER_BOX], atol=1e-3)
    assert overlap(found.mask(0), disc) > 0.95
    assert not found.mask(1).any()  # there is nothing blue there


def test_the_box_may_be_of_any_place_and_the_photo_of_any_size(tmp_path: Path) -> None:
    image, disc = scene()
    large = image.repeat(4, 0).repeat(4, 1)
    found = load_segmenter(yolo(tmp_path / "a.onnx"))(large, "bottle", (220, 140, 284, 284))
    assert overlap(found.mask, disc.repeat(4, 0).repeat(4, 1)) > 0.94
    assert found.notes == (
        "the detector takes the object in the box for another than a bottle: 'cup' (90 %, box 220 140 284 284)",
    )


def test_a_picture_of_free_size_goes_in_at_the_size_of_training(tmp_path: Path) -> None:
    image, _ = scene()
    detector = load_segmenter(yolo(tmp_path / "a.onnx", picture=["batch", 3, "height", "width"]))
    assert isinstance(detector, YoloSeg)
    found = detector.detect(image)
    assert found.masks.shape[1:] == (320, 320)
    # 640 pixels a side: the disc's box, made for 64, is a tenth as large.
    scale = 200 / 640
    np.testing.assert_allclose(found.boxes[0, 2] - found.boxes[0, 0], 71 * 0.32 * scale, atol=1e-3)


def test_without_names_80_classes_are_cocos_and_others_are_numbered(tmp_path: Path) -> None:
    coco = load_segmenter(yolo(tmp_path / "a.onnx", names=None, num_classes=80))
    assert isinstance(coco, YoloSeg)
    assert len(coco.classes) == 80
    assert coco.names[41] == "cup"
    three = load_segmenter(yolo(tmp_path / "b.onnx", names=None))
    assert isinstance(three, YoloSeg)
    assert three.classes == ["class 0", "class 1", "class 2"]
    with pytest.raises(ValueError, match=r"none of the segmenter's 3 classes \(class 0, class 1, class 2\) is a mug"):
        three(scene()[0], "mug")


@pytest.mark.parametrize("names", ["__import__('os').getcwd()", "{0: ", "[" * 10_000, "{'a': 'b'}", "x" * 300_000])
def test_names_are_read_as_literals_and_nothing_is_run(tmp_path: Path, names: str) -> None:
    with pytest.raises(ValueError, match=r"a\.onnx names its classes in a way that cannot be read") as raised:
        load_segmenter(yolo(tmp_path / "a.onnx", names=names))
    assert len(str(raised.value)) < 500
    assert "\n" not in str(raised.value)
