import io
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from skimage.data import coffee
from skimage.io import imread, imsave

from kfit.cli import pose
from kfit.cli.answer_files import document
from kfit.cli.main import main
from kfit.cli.photo_files import photo_files
from kfit.pose.object_finder import FoundObject
from kfit.segmentation import Segment


def test_folders_stand_for_their_photos(tmp_path: Path) -> None:
    for name in ("b.jpg", "a.PNG", "a_mask.png", "notes.txt", "c.heic", "b_overlay.png"):
        (tmp_path / name).touch()
    found = photo_files([str(tmp_path), "other.png", str(tmp_path / "b.jpg")])
    assert [Path(path).name for path in found] == ["a.PNG", "b.jpg", "c.heic", "other.png"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="empty holds no photos"):
        photo_files([str(tmp_path / "empty")])


def answer(category: str) -> SimpleNamespace:
    return SimpleNamespace(to_dict=lambda: {"category": category, "rotation": [[1]]})


def test_the_document_lists_objects_and_keeps_the_keys_of_one() -> None:
    one = document({"a.png": [answer("mug")]})  # type: ignore[list-item]
    assert one["version"] == 2
    assert one["category"] == "mug"
    assert one["objects"] == [{"photo": "a.png", "category": "mug", "rotation": [[1]]}]
    two = document({"a.png": [answer("mug")], "b.png": [answer("can")]})  # type: ignore[list-item]
    assert list(two) == ["version", "objects"]
    assert [found["photo"] for found in two["objects"]] == ["a.png", "b.png"]


@pytest.mark.parametrize(("typed", "picked"), [("2\n", [1]), ("2, 1\n", [1, 0]), ("\n", [0, 1]), ("1 1\n", [0])])
def test_what_is_typed_picks_from_the_list(
    typed: str, picked: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    targets = [FoundObject(name, 0.9, (1, 2, 3, 4), Segment(np.ones((2, 2)))) for name in ("mug", "can")]
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert pose._picked(targets) == [targets[number] for number in picked]
    assert "2  can (90 %), box 1 2 3 4" in capsys.readouterr().err
    for wrong in ("3\n", "mug\n", "0\n"):
        monkeypatch.setattr("sys.stdin", io.StringIO(wrong))
        with pytest.raises(ValueError, match="--pick takes numbers from 1 to 2"):
            pose._picked(targets)


def test_what_is_of_one_photo_is_refused_for_several(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["--depth", "d.png"], ["--mesh", "m.glb"], ["--report", "r.html"]):
        with pytest.raises(SystemExit):
            main(["pose", "a.png", "b.png", *words])
        assert f"{words[0]} is of one photo, but 2 were given" in capsys.readouterr().err


def test_a_wrong_recipe_is_refused_before_any_of_several_photos_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"no picture")
    with pytest.raises(SystemExit) as end:
        main(["pose", str(tmp_path), "--fit", "gone.yaml", "--out", str(tmp_path / "out")])
    assert end.value.code == 2
    assert capsys.readouterr().err == "kfit: there is no recipe gone.yaml\n"


@pytest.mark.slow
def test_a_photo_alone_and_a_folder_are_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    imsave(photos / "coffee.png", coffee(), check_contrast=False)
    main(["pose", str(photos / "coffee.png"), "--out", str(tmp_path / "one")])
    printed = capsys.readouterr()
    assert printed.out.startswith("mug ")
    assert "found a mug (" in printed.err
    alone = json.loads((tmp_path / "one/pose.json").read_text())
    assert alone["category"] == "mug"
    assert alone["category_score"] > 0.8
    imsave(photos / "mirrored.png", coffee()[:, ::-1], check_contrast=False)
    (photos / "broken.png").write_bytes(b"no picture")
    main(["pose", str(photos), "--out", str(tmp_path / "both")])
    printed = capsys.readouterr()
    assert "broken.png is not an image" in printed.err
    assert "mirrored.png" in printed.out
    both = json.loads((tmp_path / "both/pose.json").read_text())
    assert [Path(found["photo"]).name for found in both["objects"]] == ["coffee.png", "mirrored.png"]
    assert imread(tmp_path / "both/mirrored_overlay.png").shape[2] == 3
