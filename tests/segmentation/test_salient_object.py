from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx_files import is_net, overlap, scene
from skimage.data import coffee

from kfit.segmentation import SalientObject, load_segmenter, read_photo
from kfit.segmentation.salient_object import U2NET

COFFEE_MASK = Path(__file__).parents[2] / "examples/coffee_mask.png"


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


def test_specks_outside_of_the_object_are_dropped(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("side", [64, 320, 512])
def test_a_smaller_picture_is_u2_nets_whose_mask_is_stretched(tmp_path: Path, side: int) -> None:
    image, disc = scene()
    segmenter = load_segmenter(is_net(tmp_path / "a.onnx", side=side, gain=0.45))
    assert isinstance(segmenter, SalientObject)
    assert overlap(segmenter(image, "mug", (50, 30, 80, 80)).mask, disc) > 0.95


def test_u2_net_finds_nothing_where_nothing_stands_out() -> None:
    segmenter = load_segmenter(U2NET)
    with pytest.raises(ValueError, match="nothing stands out"):
        segmenter(np.full((100, 200, 3), 0.5, np.float32), "mug", (50, 30, 80, 60))


def test_the_bundled_u2_net_cuts_out_the_cup_of_coffee() -> None:
    mask = load_segmenter(U2NET)(coffee().astype(np.float32) / 255, "mug", (172, 18, 231, 288)).mask
    drawn = read_photo(COFFEE_MASK).image[..., 0] > 0.5
    assert overlap(mask, drawn) > 0.85


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
