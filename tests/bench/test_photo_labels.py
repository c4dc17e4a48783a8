import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from kfit.bench.photo_labels import Label, box_iou, faults, overlap, read_labels
from kfit.bench.photos import Row, score, totals

CAMERA = np.array([[500.0, 0, 250], [0, 500, 200], [0, 0, 1]])


def answer(category="mug", azimuth=0.0, lean=0.0, size=(0.1, 0.1, 0.1), at=(0.0, 0.0, 1.0), confidence=0.9):
    """An object that stands upright before the camera, turned about its vertical axis and then tipped towards us."""
    upright = np.diag([1.0, -1, -1])  # NOCS's y up and z towards the viewer, in OpenCV's camera
    c, s = np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(np.radians(lean)), np.sin(np.radians(lean))
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return SimpleNamespace(
        category=category,
        rotation=upright @ about_x @ about_y,
        translation=np.array(at),
        size=np.array(size),
        intrinsics=CAMERA,
        image=np.zeros((400, 500, 3)),
        bbox_xywh=(225, 175, 50, 50),
        confidence=confidence,
    )


def label(**changes):
    entry = {
        "name": "a", "category": "mug", "box": [225, 175, 50, 50], "kind": "upright", "tolerance": 10,
        "up": 90.0, "up_toward": "across", "front": 0.0, "front_toward": "across",
    }  # fmt: skip
    return Label.of({**entry, **changes})


def test_an_upright_mug_with_its_handle_to_the_right_is_right():
    assert faults(label(), answer()) == []


@pytest.mark.parametrize(("azimuth", "right"), [(20, True), (-20, True), (60, False), (180, False)])
def test_a_handle_elsewhere_is_a_fault(azimuth, right):
    assert (faults(label(up=None, up_toward=None), answer(azimuth=azimuth)) == []) is right


@pytest.mark.parametrize(("lean", "right"), [(0, False), (35, True), (50, True), (65, True), (-40, False)])
def test_a_lean_counts_instead_of_its_word(lean, right):
    wanted = label(up_lean=50.0, up_toward="toward", front=None, front_toward=None, up=90.0)
    assert (faults(wanted, answer(lean=lean)) == []) is right


@pytest.mark.parametrize(("word", "lean", "right"), [("toward", 30, True), ("toward", -30, False), ("away", -30, True)])
def test_a_word_tells_to_which_side_an_axis_leans(word, lean, right):
    wanted = label(up_toward=word, front=None, front_toward=None)
    assert (faults(wanted, answer(lean=lean)) == []) is right


def test_an_object_that_looks_the_same_upside_down_may_be():
    upside_down = answer()
    upside_down.rotation = upside_down.rotation @ np.diag([1.0, -1, -1])
    assert faults(label(front=None, front_toward=None), upside_down)
    assert not faults(label(front=None, front_toward=None, either_end=True), upside_down)


def test_the_box_around_a_cylinder_is_the_drawn_one():
    near, far = 500 * 0.05 / 0.95, 500 * 0.05
    wanted = label(category="can", box=[250 - far, 200 - near, 2 * far, 2 * near])
    assert box_iou(wanted, answer("can")) == pytest.approx(1, abs=0.02)
    assert box_iou(wanted, answer("can", at=(0.2, 0, 1))) == 0


def test_a_box_cut_by_the_photos_edge_is_compared_inside():
    wanted = label(category="can", box=[0, 170, 30, 60])
    cut = answer("can", at=(-0.5, 0.0, 1.0))
    assert box_iou(wanted, cut) > 0.7


def test_overlap_of_boxes_is_common_over_joint_area():
    assert overlap(np.array([0.0, 0, 2, 2]), np.array([1.0, 0, 3, 2])) == pytest.approx(1 / 3)
    assert overlap(np.array([0.0, 0, 1, 1]), np.array([2.0, 2, 3, 3])) == 0


def test_the_best_answer_of_the_category_is_scored():
    other, far = answer("bowl"), answer()
    far.bbox_xywh = (0, 0, 30, 30)
    row = score(label(), [other, far, answer()])
    assert row.found
    assert row.right
    assert row.mask_iou == 1
    assert score(label(), [other, far]) == Row(label())


def test_totals_count_what_is_wrong_and_sure():
    rows = [score(label(), [answer()]), score(label(), [answer(azimuth=90)]), Row(label())]
    table = totals(rows, 2)
    assert table.rows[0] == ["all", "3", "2 (67 %)", "1 (33 %)", "2 (67 %)", "1 (33 %)"]
    assert "are 2" not in table.notes[0]
    assert table.notes[0].endswith(": 2.")


def test_labels_are_read_and_faulty_ones_named(tmp_path: Path):
    entry = {"name": "a", "category": "mug", "box": [1, 2, 3, 4], "kind": "upright", "tolerance": 10, "up": 90}
    file = tmp_path / "labels.json"
    file.write_text(json.dumps({"photos": [{"file": "a.jpg", "objects": [entry]}]}))
    ((path, (read,)),) = read_labels(tmp_path).items()
    assert path == tmp_path / "a.jpg"
    assert read.axes == {"up": (90, None, None)}
    for changes, sentence in (({"category": "fork"}, "has category 'fork'"), ({"box": None}, "holds no labels")):
        file.write_text(json.dumps({"photos": [{"file": "a.jpg", "objects": [entry | changes]}]}))
        with pytest.raises(ValueError, match=sentence):
            read_labels(tmp_path)
    file.write_text("{")
    with pytest.raises(ValueError, match="holds no labels"):
        read_labels(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"holds no labels\.json"):
        read_labels(tmp_path / "none")
