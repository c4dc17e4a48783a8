"""`kfit evaluate --bop`: recall of poses in the format of the BOP challenge."""

import json
import math

import numpy as np
import pytest

from kfit.cli.main import main
from kfit.data.bop import BOPEstimate, write_bop_results
from kfit.metrics.bop_errors import bop_errors

POSE = {"cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [0, 0, 1000], "obj_id": 5}


def rotated(degrees, axis=2):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    a, b = {0: (1, 2), 1: (2, 0), 2: (0, 1)}[axis]
    rotation = np.eye(3)
    rotation[a, a], rotation[b, b], rotation[a, b], rotation[b, a] = c, c, -s, s
    return rotation


def estimate(degrees, metres=(0, 0, 1), score=1.0, kind=5, axis=2):
    return BOPEstimate(1, 2, kind, score, rotated(degrees, axis), np.array(metres, float))


@pytest.mark.parametrize(
    ("model", "degrees", "axis", "error"),
    [
        ({}, 30, 2, 30.0),
        ({"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}, 30, 2, 0.0),
        ({"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}, 30, 1, 30.0),
        ({"symmetries_discrete": [np.diag([-1.0, -1, 1, 1]).ravel().tolist()]}, 170, 2, 10.0),
    ],
)
def test_symmetries_of_the_model_count(model, degrees, axis, error):
    (one,) = bop_errors([estimate(degrees, axis=axis)], {(1, 2): [POSE]}, {"5": model}).values()
    assert one.rotation_deg[0] == pytest.approx(error, abs=1e-4)
    assert one.translation_cm[0] == pytest.approx(0, abs=1e-6)


def test_a_symmetry_off_the_origin_moves_the_object_with_it():
    turn = np.diag([-1.0, -1, 1, 1])
    turn[:3, 3] = 200, 0, 0  # about an axis at x = 100 mm
    model = {"symmetries_discrete": [turn.ravel().tolist()]}
    (one,) = bop_errors([estimate(180, (0.2, 0, 1))], {(1, 2): [POSE]}, {"5": model}).values()
    assert (one.rotation_deg[0], one.translation_cm[0]) == (pytest.approx(0, abs=1e-4), pytest.approx(0, abs=1e-6))


def test_the_surest_takes_the_nearest_and_what_is_left_was_not_found():
    far = POSE | {"cam_t_m2c": [500, 0, 1000]}
    found = [estimate(1, (0.49, 0, 1), 0.9), estimate(2, (0.45, 0, 1), 0.8), estimate(3, score=0.1)]
    (one,) = bop_errors(found, {(1, 2): [POSE, far]}, {}).values()
    assert one.rotation_deg.tolist() == pytest.approx([2, 1])
    (one,) = bop_errors(found[:1], {(1, 2): [POSE, far]}, {}).values()
    assert one.recall(5, 5) == 0.5
    assert math.isinf(one.rotation_deg[0])


def test_the_command_scores_files_and_folders_and_joins_them(tmp_path, capsys):
    root = tmp_path / "set"
    (root / "test" / "000001").mkdir(parents=True)
    (root / "test" / "000001" / "scene_gt.json").write_text(json.dumps({"2": [POSE, POSE | {"obj_id": 6}]}))
    (root / "models").mkdir()
    (root / "models" / "models_info.json").write_text("{}")
    (tmp_path / "found").mkdir()
    write_bop_results(tmp_path / "found" / "a.csv", [estimate(3)])
    write_bop_results(tmp_path / "b.csv", [estimate(8, kind=6)])
    words = [
        "evaluate",
        str(tmp_path / "found"),
        str(tmp_path / "b.csv"),
        "--bop",
        str(root),
        "--out",
        str(tmp_path / "o"),
    ]
    main(words)
    scores = json.loads((tmp_path / "o" / "scores.json").read_text())
    assert (scores["5"]["recall_5deg_2cm"], scores["6"]["recall_5deg_2cm"], scores["all"]["recall_5deg_2cm"]) == (
        1,
        0,
        0.5,
    )
    assert scores["all"]["median_deg"] == pytest.approx(5.5)
    assert len((tmp_path / "o" / "bop.csv").read_text().splitlines()) == 3
    assert "recall in %" in capsys.readouterr().out


@pytest.fixture
def data_set(tmp_path):
    """Two images with an object 5 each, the second with an object 6 too."""
    (tmp_path / "set" / "test" / "000001").mkdir(parents=True)
    scene = tmp_path / "set" / "test" / "000001" / "scene_gt.json"
    scene.write_text(json.dumps({"2": [POSE], "3": [POSE, POSE | {"obj_id": 6}]}))
    (tmp_path / "set" / "models").mkdir()
    (tmp_path / "set" / "models" / "models_info.json").write_text("{}")
    return tmp_path / "set"


def test_what_results_leave_out_is_named(data_set, tmp_path, capsys):
    write_bop_results(tmp_path / "r.csv", [estimate(0)])
    main(["evaluate", str(tmp_path / "r.csv"), "--bop", str(data_set), "--out", str(tmp_path / "o")])
    printed = capsys.readouterr().out
    assert "Not counted, as the results name them nowhere: objects 6." in printed
    assert "1 of 2 images with these objects have no results; they count as not found." in printed


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "r.csv: there are no results"),
        ("1,2,5,1,0 0 0 0 0 0 0 0 0,0 0 1000,-1", "r.csv, line 1 is no result of BOP"),
        ("1,2,5,1,-1 0 0 0 -1 0 0 0 -1,0 0 1000,-1", "R is no rotation"),
        ("1,2,5,1,nan 0 0 0 1 0 0 0 1,0 0 1000,-1", "R is no rotation"),
        ("1,2,5,1,1 0 0 0 1 0 0 0 1,0 0 nan,-1", "t must hold three finite numbers"),
        ("1,2,5,1,1 0 0 0 1 0 0 0 1,0 0 1.5,-1", "t must be in millimetres, but no object is farther than 1.5 mm"),
    ],
)
def test_files_that_are_no_results_are_refused(content, message, data_set, tmp_path, capsys):
    (tmp_path / "r.csv").write_text(content)
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", str(tmp_path / "r.csv"), "--bop", str(data_set), "--out", str(tmp_path / "o")])
    assert message in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_results_of_bop_without_their_data_set_say_what_is_missing(tmp_path, capsys):
    write_bop_results(tmp_path / "r.csv", [estimate(0)])
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", str(tmp_path / "r.csv"), "--out", str(tmp_path / "o")])
    assert "r.csv holds results in BOP's format; name the data set by --bop FOLDER" in capsys.readouterr().err


def test_an_estimate_of_an_image_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="no scene 1 with an image 2"):
        bop_errors([estimate(0)], {(1, 3): [POSE]}, {})
