"""Intervals and verdicts of the paper's tables, and the paper's own configuration."""

import numpy as np
import pytest
from torch import nn

from kfit.bench.held_out_views import held_out_views
from kfit.bench.paper import published, variants
from kfit.bench.paper.fits import Schedule, by_fit
from kfit.bench.paper.intervals import agreement, difference, pooled, share_below
from kfit.bench.paper.units import REFERENCE, TABLES
from kfit.cli.main import main
from kfit.models import load


def test_a_share_s_interval_is_wilson_s():
    # R: prop.test(80, 100, correct = FALSE) and prop.test(20, 20, correct = FALSE)
    assert share_below(np.r_[np.zeros(80), np.full(20, 90.0)], 10) == pytest.approx((80, 71.11708, 86.66331), abs=1e-4)
    assert share_below(np.zeros(20), 10) == pytest.approx((100, 83.88748, 100), abs=1e-4)


def rows(better, worse, same):
    """Errors of two rows: views in which the first alone is right, in which the second alone is, and others."""
    ours = np.r_[np.zeros(better), np.full(worse, 90.0), np.zeros(same)]
    return ours, np.r_[np.full(better, 90.0), np.zeros(worse), np.zeros(same)]


def test_views_are_paired_so_that_what_is_hard_for_both_rows_is_no_noise():
    rng = np.random.default_rng(0)
    hard = np.where(rng.random(200) < 0.5, 90.0, 1.0)
    better = hard.copy()
    better[np.flatnonzero(hard > 10)[:10]] = 1.0
    found = difference(better, hard, 10)
    assert found.value == 5
    assert found.low > 1
    # Unpaired, the noise of each is 3.5 points.
    shuffled = difference(rng.permutation(better), hard, 10)
    assert shuffled.low < 0 < shuffled.high


def test_a_failure_is_below_no_threshold():
    assert share_below(np.array([np.nan, 1.0]), 1000).value == 50
    assert share_below(np.array([np.nan, 1.0]), 60).value == 50
    assert difference(np.array([np.nan, 1.0]), np.array([1.0, 1.0]), 1000).value == -50


def test_an_ordering_counts_outside_the_noise_alone():
    assert agreement(*rows(2, 12, 30), 10, -4.2) == "reproduced"
    assert agreement(*rows(12, 2, 30), 10, -4.2) == "contradicted"
    assert agreement(*rows(3, 5, 30), 10, -4.2) == "within the noise"
    assert agreement(*rows(2, 12, 30), 10, 0.0) == "within the noise"
    assert agreement(*rows(0, 0, 30), 10, -4.2) == "within the noise"


def test_a_few_views_prove_nothing_although_a_bootstrap_of_them_leaves_out_zero():
    few = rows(4, 0, 16)
    assert difference(*few, 10).low > 0
    assert agreement(*few, 10, 4.2) == "within the noise"  # McNemar's exact test: p = 2 * 0.5**4 = 0.125
    assert agreement(*rows(6, 0, 14), 10, 4.2) == "reproduced"  # p = 2 * 0.5**6 = 0.031


def test_rows_of_different_views_are_not_compared():
    with pytest.raises(ValueError, match="of the same views, got 2 and 3"):
        difference(np.zeros(2), np.zeros(3), 10)


def test_seeds_are_pooled_view_by_view():
    one = {"rotation_deg": np.array([1.0]), "l1": np.array([0.1, 0.2]), "samples": np.zeros(3), "shift +0": np.ones(2)}
    other = {name: 3 * values for name, values in one.items()}
    found = pooled([one, other])
    assert found["rotation_deg"].tolist() == [1, 3]
    assert found["l1"].tolist() == pytest.approx([0.2, 0.4])
    assert found["shift +0"].tolist() == [1, 1, 3, 3]
    assert found["samples"].shape == (3,)


def test_the_paper_s_tables_hold_the_paper_s_networks_and_their_reference(tmp_path):
    assert all(REFERENCE[table] in TABLES[table] for table in REFERENCE)
    training = variants.Training(12, 4, tmp_path, tmp_path, tmp_path, seed=2)
    words = training.command("paper", "mug")
    # 10 |I - I'| + 0.01 mean_d KL_d, as released, is 10 times |I - I'| + 6.25e-5 sum_d KL_d for a code of 16.
    assert words[words.index("--model.init_args.kl_weight") + 1] == "6.25e-05"
    words_4 = training.command("paper_code_4", "mug")
    assert words_4[words_4.index("--model.init_args.kl_weight") + 1] == "0.00025"
    assert words[words.index("--seed_everything") + 1] == "2"
    assert training.folder("paper", "mug") == tmp_path / "seed_2" / "mug" / "paper"


@pytest.mark.parametrize(
    ("how", "weights"),
    [
        ("", {"perceptual": 1, "prior": 1}),
        ("ssim", {"ssim": 1, "prior": 0.009}),
        ("no_prior", {"perceptual": 1}),
        ("depth", {"perceptual": 1, "prior": 1, "depth": 200 / 0.46}),
        ("robustness", {"perceptual": 1, "prior": 1}),
    ],
)
def test_the_paper_s_fit_has_its_terms_and_weights(how, weights, monkeypatch):
    monkeypatch.setattr(published, "VGG16", lambda layers, weights: nn.Conv2d(3, 4, 3))
    pipeline = published.published_fit(load("laptop"), "vgg16.pth", Schedule(32, 50), how)
    assert pipeline.weights == pytest.approx(weights)
    assert (pipeline.num_starts, pipeline.num_steps, pipeline.callbacks) == (32, 50, ())


@pytest.mark.slow
def test_the_paper_s_fit_takes_depth(monkeypatch):
    monkeypatch.setattr(published, "VGG16", lambda layers, weights: nn.Conv2d(3, 4, 3))
    model = load("laptop")
    views = held_out_views(model, 1)
    pipeline = published.published_fit(model, "vgg16.pth", Schedule(2, 1), "depth")
    assert by_fit(model, views, pipeline, lambda done: None).translation_cm.item() < 50


def test_the_paper_s_tables_ask_for_vgg16_s_file(capsys, tmp_path):
    with pytest.raises(SystemExit):
        main(["bench", "paper", "--tables", "[paper_1a]", "--runs", str(tmp_path)])
    assert "give their file by --vgg16" in capsys.readouterr().err
