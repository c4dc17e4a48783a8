"""Intervals and verdicts of the paper's tables, and the paper's own configuration."""

import numpy as np
import pytest

from kfit.bench.paper import variants
from kfit.bench.paper.intervals import Interval, difference, pooled, share_below, verdict
from kfit.bench.paper.units import REFERENCE, TABLES
from kfit.cli.main import main


def test_a_share_s_interval_is_that_of_as_many_draws():
    errors = np.r_[np.zeros(80), np.full(20, 90.0)]
    value, low, high = share_below(errors, 10)
    assert value == 80
    assert low == pytest.approx(80 - 1.96 * 4, abs=1)  # sd of a binomial share: sqrt(0.8 * 0.2 / 100)
    assert high == pytest.approx(80 + 1.96 * 4, abs=1)


def test_views_are_paired_so_that_what_is_hard_for_both_rows_is_no_noise():
    rng = np.random.default_rng(0)
    hard = np.where(rng.random(200) < 0.5, 90.0, 1.0)
    better = hard.copy()
    better[np.flatnonzero(hard > 10)[:10]] = 1.0
    found = difference(better, hard, 10)
    assert found.value == 5
    assert found.sign == 1
    assert found.low > 1
    # Unpaired, the noise of each is 3.5 points.
    shuffled = difference(rng.permutation(better), hard, 10)
    assert shuffled.sign == 0


def test_a_failure_is_below_no_threshold():
    assert share_below(np.array([np.nan, 1.0]), 1000).value == 100
    assert share_below(np.array([np.nan, 1.0]), 60).value == 50


def test_an_ordering_counts_outside_the_noise_alone():
    assert verdict(Interval(-5, -9, -1), -4.2) == "yes"
    assert verdict(Interval(5, 1, 9), -4.2) == "no"
    assert verdict(Interval(-5, -9, 1), -4.2) == "open"
    assert verdict(Interval(-5, -9, -1), 0.0) == "open"


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
    assert words[words.index("--model.init_args.kl_weight") + 1] == "0.01"
    assert words[words.index("--seed_everything") + 1] == "2"
    assert training.folder("paper", "mug") == tmp_path / "seed_2" / "mug" / "paper"


def test_the_paper_s_tables_ask_for_vgg16_s_file(capsys, tmp_path):
    with pytest.raises(SystemExit):
        main(["bench", "paper", "--tables", "[paper_1a]", "--runs", str(tmp_path)])
    assert "give their file by --vgg16" in capsys.readouterr().err
