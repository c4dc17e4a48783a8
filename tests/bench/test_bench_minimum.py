"""Poses of the benchmark of minima, and its tables."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from kfit.bench import minimum_fits as fits
from kfit.bench.held_out_views import held_out_views
from kfit.cli.main import main
from kfit.energies import CodePrior
from kfit.features import PoseRefiner
from kfit.generators import SimilarityWarp
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.models import load


def rotations(count: int = 5) -> torch.Tensor:
    angles = 3 * torch.rand(3, count, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return rotation_from_angles(angles[0], angles[1], angles[2])


def test_starts_are_off_by_the_angle_also_of_their_axes() -> None:
    truth = rotations()
    found = fits.off_by(truth, 8.0, torch.Generator().manual_seed(1))
    for symmetry in ("none", "y"):
        off = rotation_error(found, truth, symmetry).rad2deg()  # type: ignore[arg-type]
        torch.testing.assert_close(off, torch.full((5,), 8.0).double())


def test_the_true_pose_is_the_first_of_32_and_alone_within_5_degrees() -> None:
    truth = rotations()
    found = fits.around(truth, torch.Generator().manual_seed(1)).unflatten(0, (5, fits.NUM_POSES))
    off = rotation_error(found, truth[:, None]).rad2deg()
    assert float(off[:, 0].abs().max()) < 1e-6
    assert float(off[:, 1:].min()) >= 5
    assert int((off > 89).sum(1).min()) == fits.NUM_FLIPS


@pytest.mark.slow
def test_true_poses_draw_objects_where_the_views_show_them() -> None:
    model = load("mug")
    views = held_out_views(model, 3)
    values = fits.true_poses(model, views)
    code, _ = model.encoder(views.observation.image)
    lens = views.observation.field("intrinsics")[:, 0, 0] / model.image_size
    with torch.no_grad():
        drawn = SimilarityWarp(model.generator)(code=code, focal=lens, **values)
    overlap = torch.minimum(drawn.mask, views.observation.field("mask")).sum((1, 2, 3))
    union = torch.maximum(drawn.mask, views.observation.field("mask")).sum((1, 2, 3))
    assert float((overlap / union).min()) > 0.75
    assert float(fits.errors_of(model, views, values).max()) < 0.1


@pytest.mark.slow
def test_each_candidate_gets_a_row_and_each_energy_a_rank(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    two = {
        "one": fits.Candidate({"ssim": 1.0}, descended=1),
        "other": fits.Candidate({"score": 1.0}, learned=1, descended=0),
    }
    monkeypatch.setattr("kfit.bench.minimum_fits.candidates", lambda refined: two if refined else {})
    monkeypatch.setattr("kfit.bench.minimum.BATCH", 1)
    save_file(PoseRefiner(None).state_dict(), tmp_path / "r.safetensors")
    words = ["--refiner", str(tmp_path / "r.safetensors"), "--out", str(tmp_path / "out")]
    main(["bench", "minimum", "--categories", "[mug]", "--views", "2", *words])
    page = (tmp_path / "out/README.md").read_text()
    assert "kfit bench minimum --categories '[mug]'" in page
    assert page.count("| one |") == page.count("| other |") == 2
    assert "before" in capsys.readouterr().out


def test_a_candidate_s_score_ranks_and_is_not_descended() -> None:
    model = load("can")
    poses = {name: torch.zeros(1) for name in ("azimuth", "elevation", "roll")}
    poses |= {"shift": torch.zeros(1, 2), "scale": torch.ones(1)}
    refiner = PoseRefiner(None, (4, 4), 4)
    made = fits.fit_from(model, fits.Candidate({"ssim": 2.0, "score": 1.0}, learned=1), poses, 1, refiner)
    assert made.weights_at(0) == {"ssim": 2.0, "score": 0.0, "prior": 0.02}
    assert made.rank_weights == {"ssim": 2.0, "score": 1.0, "prior": 0.02}
    assert isinstance(made.energies["prior"], CodePrior)
    assert made.num_steps == 1 + fits.NUM_STEPS
    assert math.isclose(made.optimizer.stages[0][1], 1)  # type: ignore[attr-defined]
