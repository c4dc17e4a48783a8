"""Folders of results that runs add to."""

import json

import pytest

from kfit.batch.results_folder import ResultsFolder

NAMES = ["a.json", "b.json"]


def test_what_has_no_file_is_left(tmp_path):
    folder = ResultsFolder(tmp_path / "out")
    assert folder.left(NAMES, {"seed": 0}) == NAMES
    assert folder.write("a.json", lambda path: path.write_text("{}"))
    assert folder.has("a.json")
    assert folder.left(NAMES, {"seed": 0}) == ["b.json"]


def test_a_file_whose_writing_fails_is_not_there_nor_is_one_that_was_not_written(tmp_path):
    folder = ResultsFolder(tmp_path)

    def fail(path):
        path.write_text("half")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        folder.write("a.json", fail)
    assert not folder.write("b.json", lambda path: None)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_unfinished_is_removed(tmp_path):
    folder = ResultsFolder(tmp_path)
    folder.left(NAMES, {})
    (tmp_path / ".partial_x").mkdir()
    (tmp_path / ".partial_x/a.json").write_text("half")
    assert folder.left(NAMES, {}) == NAMES
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]


def test_results_of_other_settings_are_refused(tmp_path):
    folder = ResultsFolder(tmp_path)
    folder.left(NAMES, {"seed": 0, "depth": True})
    with pytest.raises(ValueError, match="holds results of other settings, seed 0 there and 1 now: keep to those or"):
        folder.left(NAMES, {"seed": 1, "depth": True})
    with pytest.raises(ValueError, match="depth True there and untold now"):
        folder.left(NAMES, {"seed": 0})
    assert json.loads((tmp_path / "fit.json").read_text())["seed"] == 0
    (tmp_path / "fit.json").write_text("{")
    with pytest.raises(ValueError, match=r"fit.json is damaged"):
        folder.left(NAMES, {})


def test_results_of_unknown_settings_are_refused(tmp_path):
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(ValueError, match=r"holds results, but no fit.json with their settings"):
        ResultsFolder(tmp_path).left(NAMES, {})
