from __future__ import annotations

import json
from dataclasses import FrozenInstanceError
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from jsonargparse import Namespace
from nocs_lookalike import write_frames
from tiny_model import TINY_FIELD, write_tiny

from kfit.bench.accuracy import parser, write_card
from kfit.bench.accuracy_fits import AccuracyFits
from kfit.bench.accuracy_page import mean_of, objects_section, views_section
from kfit.bench.calibration_views import covered
from kfit.cli.main import main
from kfit.data.rasterizer import View
from kfit.models import load, read_card

QUICK = ["--starts", "2", "--steps", "1"]


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A mug's model file, small and untrained, that draws depth."""
    return write_tiny(tmp_path / "tiny.safetensors", networks=TINY_FIELD)


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    """A folder with a grey box in it, whose name says that it is a mug."""
    folder = tmp_path / "scans" / "7_mug"
    folder.mkdir(parents=True)
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 2))
    faces = "1 2 4,1 4 3,5 7 8,5 8 6,1 5 6,1 6 2,3 4 8,3 8 7,1 3 7,1 7 5,2 6 8,2 8 4"
    (folder / "box.obj").write_text(corners + "".join(f"f {face}\n" for face in faces.split(",")))
    return tmp_path / "scans"


def test_a_model_whose_objects_nothing_draws_needs_meshes_or_frames() -> None:
    models = {"teapot": SimpleNamespace(card=SimpleNamespace(shapes=None))}

    def procedural(meshes: list[str], nocs: str | None) -> object:
        return AccuracyFits(models, None, None, Namespace(meshes=meshes, nocs=nocs)).procedural()  # type: ignore[arg-type]

    assert procedural(["kept"], None) == procedural([], "frames") == {}
    with pytest.raises(ValueError, match="nothing draws objects of the category teapot; --meshes gives some"):
        procedural([], None)


def test_a_square_hides_a_share_of_the_object_and_its_mask() -> None:
    image, mask = np.full((32, 32, 3), 0.5, np.float32), np.zeros((32, 32), np.float32)
    mask[8:24, 4:28] = 1
    view = View(image, mask, mask, image)
    hidden = covered(view, np.random.default_rng(0), 0.25)
    assert hidden.mask.sum() == pytest.approx(0.75 * mask.sum(), abs=1)
    assert (hidden.image[(hidden.mask < mask)] == 1).all()
    assert np.array_equal(hidden.mask, covered(view, np.random.default_rng(0), 0.25).mask)


@pytest.mark.slow
def test_all_sources_are_printed_noted_in_the_card_and_written(
    tiny: Path, cube: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path / "nocs", [["mug", "laptop"]])
    sources = ["--views", "2", "--meshes", f"[{cube}]", "--scan-views", "1", "--nocs", str(tmp_path / "nocs")]
    main(["bench", "accuracy", "--model", str(tiny), *sources, *QUICK, "--card", "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    for words in ("Unseen procedural objects", "mug: 7_mug", "real_test scene_1/0000 1", "RGB-D: of 1 objects"):
        assert words in printed
    assert "laptop" not in printed
    saved = json.loads((tmp_path / "out/accuracy.json").read_text())
    assert saved["procedural"]["mug"]["all views"]["number"] == 2
    assert saved["scans"]["mug: 7_mug"]["all views"]["number"] == 1
    assert saved["objects"][0]["RGB"]["rotation_deg"] >= 0
    assert (saved["starts"], saved["steps"], saved["seed"]) == (2, 1, 0)
    assert saved["versions"]["torch"]
    page = (tmp_path / "out/README.md").read_text()
    assert "Made by `kfit bench accuracy --model" in page
    sheets = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert sheets == ["mug_procedural.png", "mug_real_test.png", "mug_scan_7_mug.png"]
    assert all(f"({name})" in page for name in sheets)
    assert cv2.imread(str(tmp_path / "out" / sheets[0])).std() > 10
    assert saved["objects"][0]["RGB-D"]["translation_cm"] >= 0
    accuracy = read_card(tiny).accuracy
    assert len(accuracy) == 3
    assert accuracy["unseen procedural objects, held-out families, upright views"]["all views"]["number"] == 2


def test_figures_go_into_the_file_and_not_into_the_loaded_model(tiny: Path, caplog: pytest.LogCaptureFixture) -> None:
    model = load(tiny)
    args = parser().parse_args(["--model", str(tiny)])
    with caplog.at_level("INFO", "kfit"):
        write_card({"mug": model}, args, {"mug": figures(2.0, 0.5)}, {}, [])
    assert f"wrote the figures into {tiny}" in caplog.text
    assert model.card.accuracy == {}
    assert list(read_card(tiny).accuracy) == ["unseen procedural objects, held-out families, upright views"]
    with pytest.raises(FrozenInstanceError):
        model.card.accuracy = {}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--categories", "[mug]", "--model", "x.safetensors"], "not both"),
        (["--card"], "--card needs --model"),
        (["--views", "-1"], "--views must be at least 0, got -1"),
        (["--scan-views", "0"], "--scan-views must be at least 1"),
        (["--hidden", "1"], "--hidden must be a share of at least 0 and below 1, got 1"),
        (["--views", "0"], "leaves nothing to measure"),
        (["--categories", "[]"], "--categories must name at least one"),
        (["--categories", "[bottle,teapot]"], "no bundled model"),
        (["--categories", "[mug]", "--views", "0", "--nocs", "nowhere"], "nowhere holds none of"),
        (["--categories", "[mug]", "--views", "0", "--meshes", "[nowhere]"], "meshes must name files or folders"),
    ],
)
def test_a_mistake_gets_one_sentence(words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "accuracy", *words])
    err = capsys.readouterr().err
    assert sentence in err
    assert len(err.splitlines()) == 1


def figures(median: float, share: float) -> dict:
    shares = {"number": 4, "median": median, **{f"under_{limit}": share for limit in (5, 10, 30, 60)}}
    cost = {"median translation error in cm": 2.0, "pictures a view": 9.0, "seconds a view": 0.5}
    return {"all views": shares, "called ambiguous": {}, **cost}


def test_the_last_row_is_the_mean_of_the_categories() -> None:
    both = {"mug": figures(2.0, 0.5), "bowl": figures(4.0, 1.0)}
    assert mean_of(both) == {"number": 8, "median": 3.0, **{f"under_{limit}": 0.75 for limit in (5, 10, 30, 60)}}
    section = views_section("x", both)
    assert section.rows[-1][:4] == ["mean", "8", "3.0°", "75 %"]
    assert section.rows[0] == ["mug", "4", "2.0°", *["50 %"] * 4, "2.0 cm", "0.5 s"]
    assert "| mug | 4 | 2.0° | 50 % |" in "\n".join(section.markdown())
    assert len(views_section("x", {"mug": both["mug"]}).rows) == 1


def test_objects_without_depth_are_reported_and_not_counted_as_near() -> None:
    near, far = {"rotation_deg": 4.0, "translation_cm": 1.0}, {"rotation_deg": np.nan, "translation_cm": np.nan}
    rows = [
        {"name": "a", "split": "real_test", "category": "mug", "RGB": near, "RGB-D": None},
        {"name": "b", "split": "real_test", "category": "mug", "RGB": far, "RGB-D": near},
    ]
    section = objects_section(rows)
    assert section.rows[0] == ["a", "mug", "4.0°, 1.0 cm", "no depth"]
    assert section.notes[0] == "real_test, RGB: of 2 objects 1 within 10°, 1 within 20°, 1 within 3 cm."
