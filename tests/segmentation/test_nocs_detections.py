import numpy as np
import pytest

from kfit.segmentation import nocs_detections

SHAPE = (48, 64)


def result() -> dict[str, object]:
    masks = np.zeros((*SHAPE, 3), bool)
    masks[10:20, 30:45, 0] = masks[5:9, 5:9, 1] = masks[40:48, 0:6, 2] = True
    boxes = np.array([[10, 30, 20, 45], [5, 5, 9, 9], [40, 0, 48, 6]], np.int32)
    return {
        "pred_bboxes": boxes,
        "pred_class_ids": np.array([6, 2, 6]),
        "pred_scores": np.array([0.7, 0.9, 0.8], np.float32),
        "pred_masks": masks,
        "pred_RTs": np.eye(4),
    }


def test_boxes_classes_and_masks_are_read_as_nocs_writes_them() -> None:
    found = nocs_detections(result(), SHAPE)
    assert found.names == ["mug", "bowl", "mug"]
    np.testing.assert_array_equal(found.boxes[0], [30, 10, 45, 20])
    for index in range(3):
        np.testing.assert_array_equal(found.mask(index), result()["pred_masks"][..., index])  # type: ignore[index]
    segment = found(np.zeros((*SHAPE, 3), np.float32), "mug")
    assert segment.mask[44, 3] == 1
    assert "'mug' (70 %, box 30 10 15 10)" in segment.notes[0]


def test_object_deformnets_names_serve_as_well() -> None:
    names = {"pred_bboxes": "rois", "pred_class_ids": "class_ids", "pred_scores": "scores", "pred_masks": "masks"}
    found = nocs_detections({names[key]: part for key, part in result().items() if key in names}, SHAPE)
    assert found.names == ["mug", "bowl", "mug"]


def test_a_photo_without_objects_has_none() -> None:
    # Matterport's code gives (0, 28, 28) where nothing is found.
    nothing = {
        "pred_bboxes": np.zeros((0, 4)),
        "pred_class_ids": [],
        "pred_scores": [],
        "pred_masks": np.zeros((0, 28, 28)),
    }
    found = nocs_detections(nothing, SHAPE)
    assert found.names == []
    with pytest.raises(ValueError, match="no mug was detected"):
        found(np.zeros((*SHAPE, 3), np.float32), "mug")


def test_what_is_missing_or_does_not_fit_is_named() -> None:
    with pytest.raises(ValueError, match=r"must hold pred_bboxes, .*, pred_masks; this one holds gt_bboxes"):
        nocs_detections({"gt_bboxes": 1}, SHAPE)
    with pytest.raises(ValueError, match=r"pred_masks must have shape \(48, 60, 3\), got \(48, 64, 3\)"):
        nocs_detections(result(), (48, 60))
    with pytest.raises(ValueError, match=r"pred_scores must have shape \(3,\), got \(2,\)"):
        nocs_detections(result() | {"pred_scores": np.ones(2)}, SHAPE)
