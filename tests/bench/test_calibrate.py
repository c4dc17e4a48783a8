from __future__ import annotations

from pathlib import Path

import pytest

from kfit.cli.main import main
from kfit.core import Schedule
from kfit.models import load
from kfit.pose import CategoryModel


@pytest.fixture
def model(tiny_file: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of a small untrained model whose own fit is short."""
    whole = CategoryModel.pipeline
    monkeypatch.setattr(CategoryModel, "pipeline", lambda self, **how: whole(self, 3, 2, **how))
    return tiny_file


@pytest.mark.slow
def test_calibrate_writes_the_card_and_a_table_that_check_repeats(
    model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["calibrate", "--model", str(model), "--views", "7"])
    printed, notes = capsys.readouterr()
    assert f"kfit: wrote the calibration into {model}" in notes
    assert "by cross-validation" in printed
    assert "calibration error" in printed
    assert "covariances are multiplied by" in printed
    assert [path.name for path in model.parent.iterdir()] == ["tiny.safetensors"]
    written = model.read_bytes()
    one = load(model).card.calibration["RGB"]
    assert (one.views, one.measured["seed"]) == (8, 7)
    assert (one.fits["starts"], one.fits["steps"], one.fits["left"]) == (3, 2, 3)
    assert not any(isinstance(weight, Schedule) for weight in one.fits["weights"].values())
    main(["calibrate", "--model", str(model), "--views", "2", "--seed", "0", "--check"])
    printed, notes = capsys.readouterr()
    assert "wrote" not in notes
    assert "views have an energy above the card's" in printed
    assert "right answers have the truth in the 95 % ellipsoid of their covariance" in printed
    assert model.read_bytes() == written


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--model", "mug"], "--model must name a .safetensors file, got mug"),
        (["--views", "1"], "--views must be at least 2, got 1"),
        (["--check"], "holds no calibration of RGB fits"),
        (["--check", "--depth"], "holds no calibration of RGB-D fits"),
    ],
)
def test_a_mistake_gets_one_sentence(
    model: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "--model", str(model), *words])
    assert sentence in capsys.readouterr().err
