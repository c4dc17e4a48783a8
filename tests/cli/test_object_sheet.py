"""``kfit views``: a sheet of objects, to check how they stand."""

import cv2
import pytest
import trimesh

from kfit.cli.main import main
from kfit.reports import object_sheet


@pytest.fixture
def meshes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a3f1", "b77c"):
        (tmp_path / "meshes" / name).mkdir(parents=True)
        trimesh.creation.box((1, 2, 3)).export(tmp_path / "meshes" / name / "model.obj")


def test_rows_of_files_with_one_name_are_told_apart_by_their_folders(meshes, tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr(object_sheet, "put_text", lambda picture, text, *where: written.append(text))
    main(["views", "--category", "mug", "--meshes", "meshes@z", "--show", "sheet.png"])
    assert "a3f1/model.obj, up z, front x" in written
    assert "b77c/model.obj, up z, front x" in written
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[0] > 300


@pytest.mark.parametrize(("objects", "counted"), [("2", False), ("1", True)])
def test_the_number_of_meshes_is_told_only_if_some_are_not_drawn(meshes, capsys, objects, counted):
    main(["views", "--category", "mug", "--meshes", "meshes", "--objects", objects, "--show", "sheet.png"])
    assert ("drawing 1 of 2 meshes; --objects changes that" in capsys.readouterr().err) is counted
