"""`CategoryModel.pose` with segmenters; what these find is tested beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kfit.pose import CategoryModel
from kfit.segmentation import Box, Segment, Segmenter, nocs_detections

IMAGE = np.full((60, 80, 3), 0.5, np.float32)


class Fixed(Segmenter):
    """Finds the box, or a fixed place, and remembers what it was asked."""

    def __call__(self, image: np.ndarray, category: str, box: Box | None = None) -> Segment:
        self.asked = (image.shape, category, box)
        left, top, width, height = (10, 20, 30, 15) if box is None else map(int, box)
        mask = np.zeros(image.shape[:2], np.float32)
        mask[top : top + height, left : left + width] = 1
        return Segment(mask, ("told",))


@pytest.mark.parametrize("box", [None, (5, 6, 20, 30)])
def test_a_segmenter_is_asked_for_the_models_category(tiny_model: CategoryModel, box: Box | None) -> None:
    network = Fixed()
    result = tiny_model.pose(IMAGE, box=box, segmenter=network, pipeline=tiny_model.pipeline(2, 1))
    assert network.asked == ((60, 80, 3), "mug", box)
    assert result.bbox_xywh == (box or (10, 20, 30, 15))
    assert result.notes[0] == "told"


def test_detections_serve_as_a_segmenter(tiny_model: CategoryModel) -> None:
    masks = np.zeros((60, 80, 2), bool)
    masks[10:30, 5:25, 0] = masks[30:50, 40:70, 1] = True
    settings = {
        "pred_bboxes": np.array([[10, 5, 30, 25], [30, 40, 50, 70]]),
        "pred_class_ids": np.array([2, 6]),
        "pred_scores": np.array([0.9, 0.8]),
        "pred_masks": masks,
    }
    detections = nocs_detections(settings, (60, 80))
    result = tiny_model.pose(IMAGE, segmenter=detections, pipeline=tiny_model.pipeline(2, 1))
    assert result.bbox_xywh == (40, 30, 30, 20)


def test_a_path_is_a_model_file(tiny_model: CategoryModel, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no ONNX file .*none\.onnx"):
        tiny_model.pose(IMAGE, segmenter=tmp_path / "none.onnx")


def test_a_segmenter_with_a_mask_is_refused(tiny_model: CategoryModel) -> None:
    with pytest.raises(ValueError, match="mask and segmenter were both given"):
        tiny_model.pose(IMAGE, mask=np.ones((60, 80)), segmenter=Fixed())
