from __future__ import annotations

from pathlib import Path

import pytest
import torch

from kfit.cli.main import main
from kfit.core import Schedule
from kfit.generators import VAE3D, ConvEncoder, ExtentsHead
from kfit.models import load, write_model
from kfit.pose import Card, CategoryModel

SIZES = {
    "generator": {"code_dim": 4, "volume_dims": [8, 8, 4], "projection_dim": 8, "decoder_dims": [8, 8]},
    "encoder": {"code_dim": 4, "channels": [8, 8, 8, 8]},
    "extents": {"code_dim": 4},
}
KINDS = {"generator": VAE3D, "encoder": ConvEncoder, "extents": ExtentsHead}


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of a small untrained model whose own fit is short."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        networks = {name: kind(**SIZES[name]) for name, kind in KINDS.items()}
    said = {
        name: {"class_path": f"kfit.generators.{kind.__name__}", "init_args": SIZES[name]}
        for name, kind in KINDS.items()
    }
    path = tmp_path / "tiny.safetensors"
    write_model(path, networks, Card("mug", said, 4.0, 1.0, (-15.0, 75.0), "y up", "none", 0.17))
    whole = CategoryModel.pipeline
    monkeypatch.setattr(CategoryModel, "pipeline", lambda self, **how: whole(self, 3, 2, **how))
    return path


@pytest.mark.slow
def test_calibrate_writes_the_card_and_a_table_that_check_repeats(
    model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["calibrate", "--model", str(model), "--views", "7"])
    said = capsys.readouterr().out
    assert "by cross-validation" in said
    assert "calibration error" in said
    assert "covariances are multiplied by" in said
    assert [path.name for path in model.parent.iterdir()] == ["tiny.safetensors"]
    written = model.read_bytes()
    one = load(model).card.calibration["RGB"]
    assert (one.views, one.measured["seed"]) == (8, 7)
    assert (one.fits["starts"], one.fits["steps"], one.fits["left"]) == (3, 2, 3)
    assert not any(isinstance(weight, Schedule) for weight in one.fits["weights"].values())
    main(["calibrate", "--model", str(model), "--views", "2", "--seed", "0", "--check"])
    said = capsys.readouterr().out
    assert "views have an energy above the card's" in said
    assert "right answers have the truth in the 95 % ellipsoid of their covariance" in said
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
