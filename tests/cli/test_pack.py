"""Packing a checkpoint that the paper's authors released, and finding a pose with it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from released_weights import released_weights
from scipy.spatial.transform import Rotation
from skimage.io import imsave

import kfit
from kfit.cli.main import main
from kfit.data import shapes
from kfit.energies import L1
from kfit.generators import SimilarityWarp
from kfit.initializers import Constant
from kfit.models import load_released, read_card, released_values
from kfit.optimizers import Adam


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("released") / "model_latest.pth"
    torch.save(released_weights(), path)
    return path


@pytest.fixture(scope="module")
def packed(checkpoint: Path) -> Path:
    path = checkpoint.with_name("laptop.safetensors")
    main(["pack", str(checkpoint), "--category", "laptop", "--out", str(path)])
    return path


@pytest.mark.slow
def test_a_packed_released_model_draws_and_reads_what_the_checkpoint_does(checkpoint: Path, packed: Path) -> None:
    model, (generator, encoder) = kfit.load(packed), load_released(checkpoint)
    values = {"code": torch.randn(2, 16), "azimuth": torch.tensor([0.3, 2.0]), "elevation": torch.tensor([0.1, 0.8])}
    picture = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        torch.testing.assert_close(model.generator(**values).image, generator(**values).image, rtol=0, atol=5e-3)
        torch.testing.assert_close(model.encoder(picture)[0], encoder(picture)[0], rtol=0, atol=5e-3)
    assert model.drawn == {"image"}


@pytest.mark.slow
def test_its_card_names_what_the_checkpoint_does_not_hold(packed: Path) -> None:
    card, model = read_card(packed), kfit.load(packed)
    assert (card.category, card.axes, card.calibration) == ("laptop", "y up, screen facing +x", {})
    assert "mean of 64 procedural objects" in card.training["assumed"]
    sides = np.mean([shapes.build("laptop", seed)[0].extents for seed in range(64)], 0)
    with torch.no_grad():
        found = model.extents(torch.randn(3, 16))
    np.testing.assert_allclose(found, np.tile(sides / np.linalg.norm(sides), (3, 1)), atol=1e-3)


@pytest.mark.slow
def test_its_pose_is_what_the_released_code_reports(packed: Path) -> None:
    model = kfit.load(packed)
    ax, ay, az = 0.21, 0.13, 0.04  # half-turns
    row = torch.ones(1)
    values = released_values(
        torch.randn(1, 16), 180 * ax * row, 180 * ay * row, math.pi * az * row, 0 * row, 0 * row, row
    )
    pipeline = kfit.FitPipeline(
        SimilarityWarp(model.generator),
        {"l1": L1()},
        [Constant({name: value[0] for name, value in values.items()})],
        Adam(0.01),
        num_starts=1,
        num_steps=0,
    )
    mask = np.zeros((65, 65))
    mask[8:57, 8:57] = 1  # in the middle, where the viewing ray is the camera's axis
    result = model.pose(np.random.default_rng(0).random((65, 65, 3)), mask=mask, pipeline=pipeline)
    expected = Rotation.from_euler("yxz", np.array([-ay - 0.5, ax + 1, -az]) * 180, degrees=True).as_matrix()
    np.testing.assert_allclose(result.rotation, expected, atol=1e-5)


@pytest.mark.slow
def test_kfit_pose_fits_with_it(packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = kfit.pose.CategoryModel.pipeline
    monkeypatch.setattr(kfit.pose.CategoryModel, "pipeline", lambda self, **how: whole(self, 2, 2, **how))
    picture = np.random.default_rng(0).integers(0, 255, (80, 90, 3), np.uint8)
    mask = np.zeros((80, 90), np.uint8)
    mask[10:70, 15:75] = 255
    imsave(tmp_path / "photo.png", picture, check_contrast=False)
    imsave(tmp_path / "mask.png", mask, check_contrast=False)
    words = ["--model", str(packed), "--mask", str(tmp_path / "mask.png"), "--out", str(tmp_path / "out")]
    main(["pose", str(tmp_path / "photo.png"), *words])
    found = json.loads((tmp_path / "out/pose.json").read_text())
    assert found["category"] == "laptop"
    assert np.linalg.det(np.array(found["rotation"])) == pytest.approx(1)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "a released one of neural_object_fitting, which `kfit pack --category` takes"),
        (["--category", "teapot"], "category must be one of bottle, bowl"),
    ],
)
def test_a_released_checkpoint_needs_a_known_category(
    checkpoint: Path, tmp_path: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["pack", str(checkpoint), *words, "--out", str(tmp_path / "x.safetensors")])
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
