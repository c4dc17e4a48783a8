from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny_model import TINY_FIELD, write_tiny

from kfit.bench import accuracy_fits
from kfit.bench.energies import mixes, section
from kfit.cli.main import main
from kfit.energies import Silhouette
from kfit.models import load
from kfit.pose import CategoryModel

QUICK = ["--views", "1", "--starts", "2", "--steps", "1"]


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A mug's model file, small and untrained, that draws depth."""
    return write_tiny(tmp_path / "tiny.safetensors", networks=TINY_FIELD)


def two(vgg16: str | None) -> dict[str, object]:
    """Fewer energies than the command compares, to be quick."""
    assert vgg16 is None
    return {name: lambda model: {"silhouette": (Silhouette(), 1.0)} for name in ("one", "other")}


@pytest.mark.slow
def test_each_energy_gets_a_row_and_nothing_is_measured_twice(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("kfit.bench.energies.mixes", two)
    words = ["bench", "energies", "--model", str(tiny), *QUICK, "--out", str(tmp_path / "out")]
    drawn: list[int] = []
    views = accuracy_fits.held_out_views
    monkeypatch.setattr(
        accuracy_fits, "held_out_views", lambda *args, **also: (drawn.append(1), views(*args, **also))[1]
    )
    main(words)
    assert drawn == [1]  # for both
    printed = capsys.readouterr()
    assert "one" in printed.out
    assert "other" in printed.out
    assert "--vgg16 FILE" in printed.err
    page = (tmp_path / "out/README.md").read_text()
    assert "kfit bench energies --model" in page
    path = tmp_path / "out/energies.json"
    saved = json.loads(path.read_text())
    assert saved["found"]["one"]["procedural"]["mug"]["all views"]["number"] == 1
    del saved["found"]["other"]  # as if stopped after the first
    path.write_text(json.dumps(saved))
    calls: list[int] = []
    once = accuracy_fits.AccuracyFits.procedural
    monkeypatch.setattr(accuracy_fits.AccuracyFits, "procedural", lambda self: (calls.append(1), once(self))[1])
    main(words)
    assert calls == [1]
    main(words)
    assert calls == [1]
    main([*words, "--seed", "3"])
    assert calls == [1, 1, 1]


def test_every_energy_fits_a_model() -> None:
    model = load("mug")
    assert isinstance(model, CategoryModel)
    found = mixes(None)
    assert len(found) == 6
    for make in found.values():
        pipeline = model.pipeline(2, 1, energies=make(model))
        assert set(make(model)) | {"prior", "pose"} == set(pipeline.energies)
        assert all(pipeline.weights[name] == weight for name, (_, weight) in make(model).items())


def test_frames_are_reported_by_median_and_shares() -> None:
    objects = [{"RGB": {"rotation_deg": error, "translation_cm": 1.0}} for error in (3.0, 12.0, 40.0)]
    (row,) = section({"SSIM": {"procedural": {}, "scans": {}, "objects": objects}}).rows
    assert row == ["SSIM", "12.0°", "1 of 3", "2 of 3"]
