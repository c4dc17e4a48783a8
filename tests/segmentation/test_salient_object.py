from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx_files import is_net, overlap, scene

from kfit.segmentation import SalientObject, load_segmenter, read_photo


def test_what_stands_out_in_the_box_is_found(tmp_path: Path) -> None:
    image, disc = scene()
    segmenter = load_segmenter(is_net(tmp_path / "a.onnx"))
    assert isinstance(segmenter, SalientObject)
    found = segmenter(image, "mug", (50, 30, 80, 80))
    assert found.notes == ()
    assert overlap(found.mask, disc) > 0.98
    half = segmenter(image, "mug", (50, 30, 40, 80))
    assert not half.mask[:, 90:].any()
    np.testing.assert_array_equal(half.mask[:, 50:90], disc[:, 50:90])


def test_specks_beside_the_object_are_left_out(tmp_path: Path) -> None:
    image, disc = scene()
    image[104:107, 124:128] = (0.1, 0.2, 0.8)
    found = load_segmenter(is_net(tmp_path / "a.onnx"))(image, "mug", (50, 30, 80, 80))
    assert not found.mask[104:107, 124:128].any()
    assert overlap(found.mask, disc) > 0.98


def test_without_a_box_the_whole_picture_is_looked_at(tmp_path: Path) -> None:
    image, disc = scene()
    found = load_segmenter(is_net(tmp_path / "a.onnx"))(image, "mug")
    assert overlap(found.mask, disc) > 0.98
    assert "the whole picture" in found.notes[0]


def test_a_box_without_an_object_is_refused(tmp_path: Path) -> None:
    segmenter = load_segmenter(is_net(tmp_path / "a.onnx"))
    with pytest.raises(ValueError, match=r"no object found in box \(150, 100, 40, 40\): nothing stands out"):
        segmenter(scene()[0], "mug", (150, 100, 40, 40))
    with pytest.raises(ValueError, match="has no area"):
        segmenter(scene()[0], "mug", (150, 100, 0, 40))


def test_numbers_beyond_one_are_no_mask(tmp_path: Path) -> None:
    segmenter = load_segmenter(is_net(tmp_path / "a.onnx", gain=8.0))
    with pytest.raises(ValueError, match=r"a\.onnx gave numbers from 0\.00 to 8\.00, not a mask in \[0, 1\]"):
        segmenter(scene()[0], "mug", (50, 30, 80, 80))


@pytest.mark.slow
def test_is_net_finds_real_objects_in_their_boxes(dev_data: Path) -> None:
    frame = dev_data / "nocs_sample/real_train/scene_1/0000"
    image = read_photo(f"{frame}_color.png").image
    truths = cv2.imread(f"{frame}_mask.png", cv2.IMREAD_UNCHANGED)
    segmenter = load_segmenter(dev_data / "segmentation/isnet_small.onnx")
    overlaps = []
    for instance in range(1, 6):
        truth = truths == instance
        box = cv2.boundingRect(truth.astype(np.uint8))
        overlaps.append(overlap(segmenter(image, "mug", box).mask, truth))
    assert min(overlaps) > 0.7
    assert np.median(overlaps) > 0.9
