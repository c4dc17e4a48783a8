"""`kfit evaluate` from result files to tables and plots."""

from __future__ import annotations

import csv
import json
import pickle

import numpy as np
import pytest
from skimage.io import imread

from kfit.cli.main import main
from kfit.data import dump_pickle, load_pickle

SIZE = np.array([0.6, 0.64, 0.48])


def write_results(folder, off_deg, off_cm, classes=(1, 2, 3, 4, 5, 6), **more):
    """Two images with an object of each class, found with the same error each."""
    folder.mkdir()
    angle = np.deg2rad(off_deg)
    c, s = np.cos(angle), np.sin(angle)
    for image in range(2):
        truths = np.tile(np.diag([0.2, 0.2, 0.2, 1.0]), (len(classes), 1, 1))
        truths[:, :3, 3] = [[0.3 * k, 0.1 * image, 1.2] for k in range(len(classes))]
        found = truths.copy()
        found[:, :3, :3] = truths[:, :3, :3] @ [[1, 0, 0], [0, c, -s], [0, s, c]]
        found[:, 2, 3] += off_cm / 100
        ids, sizes = np.array(classes), np.tile(SIZE, (len(classes), 1))
        result = {
            "image_path": f"data/real/test/scene_1/{image:04}",
            **{"gt_class_ids": ids, "gt_RTs": truths, "gt_scales": sizes},
            **{
                "pred_class_ids": ids,
                "pred_RTs": found,
                "pred_scales": sizes,
                "pred_scores": np.linspace(1, 0.5, len(ids)),
            },
            **more,
        }
        dump_pickle(folder / f"results_test_scene_1_{image:04}.pkl", result)
    return folder


def test_one_method_is_printed_and_written(tmp_path, capsys):
    folder = write_results(tmp_path / "ours", 7, 3)
    main(["evaluate", str(folder), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    for column in ("IoU25", "IoU50", "IoU75", "5°2cm", "5°5cm", "10°5cm", "10°10cm", "10°", "60°", "ours"):
        assert column in printed
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        *("curves.png", "scores.csv", "scores.json", "scores.md")
    ]
    rows = list(csv.DictReader((tmp_path / "out/scores.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["category"] for row in rows] == ["bottle", "bowl", "camera", "can", "laptop", "mug", "mean"]
    mean = rows[-1]
    assert (mean["objects"], mean["found"]) == ("12", "12")
    assert [float(mean[name]) for name in ("5°5cm", "10°5cm", "10°10cm")] == [0, 100, 100]
    saved = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))
    assert saved["methods"]["ours"]["table"]["mean"]["10°5cm"] == 100
    curve = saved["methods"]["ours"]["rotation_curve"]
    assert curve["degrees"] == list(range(61))
    assert curve["laptop"] == [0.0] * 7 + [1.0] * 54
    assert "| mean | 12 | 12 | 12 |" in (tmp_path / "out/scores.md").read_text(encoding="utf-8")
    assert imread(tmp_path / "out/curves.png").std() > 0


@pytest.mark.slow
def test_folders_are_methods_and_files_are_one(tmp_path, capsys):
    near, far = write_results(tmp_path / "near", 3, 1), write_results(tmp_path / "far", 20, 8)
    main(["evaluate", str(near), *map(str, far.iterdir()), "--out", str(tmp_path / "out")])
    saved = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]
    assert {name: method["table"]["mean"]["5°5cm"] for name, method in saved.items()} == {"far": 0, "near": 100}
    for name in ("curves", "rotation", "translation", "iou"):
        assert imread(tmp_path / f"out/{name}.png").std() > 0
    printed = capsys.readouterr().out
    assert printed.index("far") < printed.index("near")


def test_a_category_without_objects_is_reported(tmp_path, capsys):
    write_results(tmp_path / "ours", 2, 1, classes=(5, 6))
    main(["evaluate", str(tmp_path / "ours"), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert "no bottle, bowl, camera, can in the images; the published mean counts each as 0" in printed
    table = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["table"]
    assert table["mean"]["5°5cm"] == pytest.approx(100 / 3)
    assert table["mean of those present"]["5°5cm"] == 100


def test_what_is_not_defined_is_a_dash_or_null(tmp_path, capsys):
    folder = write_results(tmp_path / "ours", 2, 1, classes=(6,))
    path = folder / "results_test_scene_1_0000.pkl"
    dump_pickle(path, load_pickle(path) | {"gt_class_ids": np.array([5])})
    main(["evaluate", str(folder), "--out", str(tmp_path / "out")])
    table = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["table"]
    assert table["laptop"]["IoU25"] == 0
    path.write_bytes((folder / "results_test_scene_1_0001.pkl").read_bytes())
    dump_pickle(path, load_pickle(path) | {"pred_class_ids": np.array([4])})
    main(["evaluate", str(folder), "--out", str(tmp_path / "out")])
    table = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["table"]
    assert table["can"]["IoU25"] is None
    assert "–" in capsys.readouterr().out


@pytest.mark.parametrize("iou", ["axis_aligned", "oriented"])
def test_boxes_are_compared_as_asked(tmp_path, iou, capsys):
    write_results(tmp_path / "ours", 0, 3, classes=(5,))
    main(["evaluate", str(tmp_path / "ours"), "--out", str(tmp_path / "out"), "--iou", iou])
    curve = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["iou_curve"]
    depth = 0.2 * SIZE[2]
    overlap = (depth - 0.03) / (depth + 0.03)
    assert [value == 1 for value in curve["laptop"]] == [limit < overlap for limit in curve["thresholds"]]


def test_free_of_scale_distances_are_in_diagonals(tmp_path, capsys):
    folder = write_results(tmp_path / "ours", 0, 0)
    for path in folder.iterdir():
        result = load_pickle(path)
        result["pred_RTs"][:, :3] *= 1.5
        dump_pickle(path, result)
    main(["evaluate", str(folder), "--out", str(tmp_path / "out"), "--scale-agnostic"])
    assert "5°0.2d" in capsys.readouterr().out
    table = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["table"]
    assert table["mean"]["5°0.2d"] == table["mean"]["NIoU75"] == 100


def test_other_poses_are_evaluated_on_the_same_boxes(tmp_path, capsys):
    ours = np.tile(np.eye(4), (6, 1, 1))
    folder = write_results(tmp_path / "ours", 20, 1, pred_RTs_ours=ours)
    main(["evaluate", str(folder), "--out", str(tmp_path / "out"), "--poses", "pred_RTs_ours"])
    table = json.loads((tmp_path / "out/scores.json").read_text(encoding="utf-8"))["methods"]["ours"]["table"]
    assert (table["mean"]["10°"], table["mean"]["10°10cm"]) == (100, 0)
    assert "and are pred_RTs_ours" in capsys.readouterr().out


def test_a_mistake_gets_one_sentence_and_writes_nothing(tmp_path, capsys):
    good = write_results(tmp_path / "good", 1, 1)
    (tmp_path / "empty").mkdir()
    truth, harmful = tmp_path / "results_truth.pkl", tmp_path / "results_harmful.pkl"
    truth.write_bytes(pickle.dumps({"gt_class_ids": np.ones(1)}, protocol=3))
    harmful.write_bytes(pickle.dumps([print], protocol=3))
    (tmp_path / "results_cut.pkl").write_bytes(truth.read_bytes()[:20])
    for words, sentence in [
        (["nowhere"], "there is no file or folder nowhere"),
        ([str(tmp_path / "empty")], "holds no results_*.pkl"),
        ([str(truth)], "holds true poses but no predictions"),
        ([str(harmful)], "asks for builtins.print"),
        ([str(tmp_path / "results_cut.pkl")], "is damaged or no pickle"),
        ([str(good), "--poses", "pred_RTs_ours"], "has no pred_RTs_ours"),
        ([str(good), "--poses", "pred_RTs_ours", "--scale-agnostic"], "leave --poses out"),
    ]:
        with pytest.raises(SystemExit) as stopped:
            main(["evaluate", *words, "--out", str(tmp_path / "out")])
        printed = capsys.readouterr()
        assert stopped.value.code == 2
        assert sentence in printed.err
        assert len(printed.err.splitlines()) == 1, printed.err
        assert printed.out == ""
    assert not (tmp_path / "out").exists()
