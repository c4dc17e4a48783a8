"""NOCS's result files, written and read."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from kfit.data import NOCSFrame, NOCSObject, NOCSPrediction, make_result, read_results, result_files, write_result
from kfit.data.nocs_models import NOCSModel
from kfit.metrics import evaluate_nocs

POSE = np.diag([0.2, 0.2, 0.2, 1])
SIZE = np.array([0.6, 0.64, 0.48])


def frame(pose=POSE, size=SIZE):
    mask = np.zeros((8, 8), bool)
    mask[2:5, 3:6] = True
    mug = NOCSObject(3, "mug", NOCSModel("mug_a"), mask, np.array([2, 3, 5, 6], np.int32), pose, size, False)
    blank = np.zeros((8, 8, 3), np.uint8)
    depth = np.zeros((8, 8), np.float32)
    return NOCSFrame(Path("data/real/test/scene_1/0004"), blank, depth, blank / 1.0, np.eye(3), (mug,))


def prediction(mask=None, category="mug"):
    return NOCSPrediction(category, np.eye(3), np.zeros(3), 0.2 * SIZE, 0.9, (2, 3, 5, 6), mask)


def test_a_result_holds_what_nocs_holds_and_is_scored(tmp_path):
    path = write_result(tmp_path / "out", make_result(frame(), [prediction(np.ones((8, 8), bool))]))
    assert path.name == "results_test_scene_1_0004.pkl"
    # As others read it.
    result = pickle.loads(path.read_bytes())
    assert {key: (value.shape, value.dtype.name) for key, value in result.items() if key != "image_path"} == {
        "gt_class_ids": ((1,), "int64"),
        "gt_bboxes": ((1, 4), "int32"),
        "gt_RTs": ((1, 4, 4), "float64"),
        "gt_scales": ((1, 3), "float32"),
        "gt_handle_visibility": ((1,), "int64"),
        "pred_class_ids": ((1,), "int64"),
        "pred_bboxes": ((1, 4), "int32"),
        "pred_RTs": ((1, 4, 4), "float64"),
        "pred_scales": ((1, 3), "float32"),
        "pred_scores": ((1,), "float32"),
        "pred_masks": ((8, 8, 1), "uint8"),
    }
    assert result["gt_handle_visibility"] == 0
    np.testing.assert_allclose(result["pred_RTs"], result["gt_RTs"], atol=1e-12)
    np.testing.assert_allclose(result["pred_scales"], result["gt_scales"])
    scores = evaluate_nocs(read_results(result_files(tmp_path / "out")), iou="oriented")
    assert scores.iou(0.75)[5] == 1
    assert scores.pose(5, 5)[5] == 1


def test_an_image_where_nothing_is_found_is_written_too(tmp_path):
    (result,) = read_results([write_result(tmp_path, make_result(frame(), []))])
    assert result["pred_RTs"].shape == (0, 4, 4)
    assert "pred_masks" not in result
    assert evaluate_nocs([result]).num_truths[5] == 1


def test_objects_that_cannot_be_scored_are_named():
    with pytest.raises(ValueError, match=r"object 3 of .*0004, a mug, has no pose"):
        make_result(frame(pose=None), [])
    with pytest.raises(ValueError, match="has no size, which gts or obj_models would give"):
        make_result(frame(size=None), [])
    with pytest.raises(ValueError, match="must have an image_path"):
        write_result("out", {})


def test_files_are_found_sorted_and_lists_of_results_are_read(tmp_path):
    one = make_result(frame(), [])
    for name in ("results_b.pkl", "results_a.pkl", "other.pkl"):
        (tmp_path / name).write_bytes(pickle.dumps([one, {**one, "image_path": None}], protocol=3))
    files = result_files(tmp_path)
    assert [path.name for path in files] == ["results_a.pkl", "results_b.pkl"]
    assert result_files(tmp_path / "other.pkl") == [tmp_path / "other.pkl"]
    assert [result["image_path"] for result in read_results(files[:1])] == [one["image_path"], str(files[0])]


def test_what_holds_no_results_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"holds no results_\*\.pkl"):
        result_files(tmp_path)
    with pytest.raises(FileNotFoundError, match="there is no file or folder"):
        result_files(tmp_path / "none")
    for content, sentence in (
        ({"mug": 1}, "holds no results of NOCS"),
        ({"gt_class_ids": np.zeros(1)}, "holds true poses but no predictions"),
    ):
        (tmp_path / "results_a.pkl").write_bytes(pickle.dumps(content, protocol=3))
        with pytest.raises(ValueError, match=sentence):
            list(read_results(result_files(tmp_path)))
