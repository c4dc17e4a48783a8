from pathlib import Path

import numpy as np
import pytest
from onnx_files import DISC_BOX, OTHER_BOX, mask_rcnn, overlap, scene, zoo_mask_rcnn

from kfit.segmentation import MaskRCNN, OnnxNetwork, load_segmenter


def test_torchvisions_masks_span_the_picture_and_its_labels_are_cocos(tmp_path: Path) -> None:
    image, disc = scene()
    detector = load_segmenter(mask_rcnn(tmp_path / "a.onnx"))
    assert isinstance(detector, MaskRCNN)
    found = detector.detect(image)
    assert found.names == ["cup", "bottle"]  # the third has no area
    np.testing.assert_allclose(found.boxes, [DISC_BOX, OTHER_BOX], atol=1e-4)
    np.testing.assert_array_equal(found.mask(0), disc)


def test_a_large_photo_goes_in_at_1333_pixels(tmp_path: Path) -> None:
    image, disc = scene()
    large, there = (part.repeat(10, 0).repeat(10, 1) for part in (image, disc))
    found = load_segmenter(mask_rcnn(tmp_path / "a.onnx", scale=1333 / 200))(large, "mug")
    assert overlap(found.mask, there) > 0.99


def test_the_zoos_masks_are_patches_in_boxes_and_its_labels_count_from_one(tmp_path: Path) -> None:
    image, disc = scene()
    detector = load_segmenter(zoo_mask_rcnn(tmp_path / "a.onnx"))
    assert isinstance(detector, MaskRCNN)
    found = detector.detect(image)
    assert found.names == ["cup"]
    np.testing.assert_allclose(found.boxes, [DISC_BOX], atol=0.05)  # 1066.7 pixels became 1067
    assert overlap(found.mask(0), disc) > 0.95


def test_the_zoos_picture_is_bgr_less_its_mean_with_a_margin_of_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image, _ = scene()
    recorded, run = [], OnnxNetwork.run
    monkeypatch.setattr(
        OnnxNetwork, "run", lambda self, picture, names: recorded.append(picture) or run(self, picture, names)
    )
    load_segmenter(zoo_mask_rcnn(tmp_path / "a.onnx"))(image, "mug")
    # 200 x 150 becomes 1067 x 800, and its width a multiple of 32.
    assert recorded[0].shape == (800, 1088, 3)
    assert np.abs(recorded[0][:, 1067:]).max() < 1e-4
    disc = 255 * np.array([0.8, 0.2, 0.1]) - (102.9801, 115.9465, 122.7717)
    np.testing.assert_allclose(recorded[0][373, 480], disc, atol=1e-3)


def test_labels_come_from_the_file_if_it_has_them(tmp_path: Path) -> None:
    detector = load_segmenter(mask_rcnn(tmp_path / "a.onnx", names="{47: 'bowl'}"))
    assert isinstance(detector, MaskRCNN)
    assert detector.detect(scene()[0]).names == ["bowl", "class 44"]
