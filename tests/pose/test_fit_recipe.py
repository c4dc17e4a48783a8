"""Fits that recipes describe, by any model."""

from pathlib import Path

import pytest
import torch
import yaml

from kfit.bench.held_out_views import held_out_views
from kfit.features import PoseRefiner
from kfit.initializers import EncoderPosterior
from kfit.models import load
from kfit.optimizers import Adam, LearnedSteps
from kfit.pose.fit_recipe import fit_of

LEARNED = Path(__file__).parents[2] / "recipes/fit_learned.yaml"
RELEASED = Path(__file__).parents[2] / "recipes/fit_released.yaml"
NETWORK = "--energies.perceptual.init_args.network"
OFFLINE = [NETWORK, "kfit.features.EfficientNetLite0"]


def test_the_released_fit_has_the_released_numbers():
    fit = fit_of(RELEASED, load("laptop"), OFFLINE)
    assert (fit.num_starts, fit.num_candidates, fit.num_steps) == (32, 32, 50)
    assert fit.weights == {"perceptual": 1.0, "prior": 1.0}
    assert isinstance(fit.optimizer, Adam)
    assert (fit.optimizer.betas, fit.optimizer.decay) == ((0.5, 0.999), 1.0)
    assert fit.optimizer.rates["code"] == 0.3
    assert fit.callbacks == ()
    assert isinstance(fit.initializers[-1], EncoderPosterior)


@pytest.mark.parametrize(("category", "symmetry"), [("laptop", "none"), ("can", "y")])
def test_the_selector_gets_the_symmetry(category, symmetry):
    assert fit_of(RELEASED, load(category), OFFLINE).selector.symmetry == symmetry


def test_it_fits():
    model = load("laptop")
    fit = fit_of(RELEASED, model, [*OFFLINE, "--num_starts", "2", "--num_steps", "1"])
    result = fit(held_out_views(model, 1).observation, seed=0)
    assert result.num_evaluations == 4
    assert torch.isfinite(result.energy).all()


def test_learned_steps_come_before_a_descent(tmp_path, monkeypatch):
    model = load("can")
    monkeypatch.chdir(tmp_path)
    torch.save({"state_dict": PoseRefiner(None).state_dict()}, "refiner.ckpt")
    fit = fit_of(LEARNED, model, ["--num_starts", "2", "--num_steps", "4"])
    assert [(type(optimizer), steps) for optimizer, steps in fit.optimizer.stages] == [(LearnedSteps, 3), (Adam, 13)]
    assert fit.rank_weights["score"] == 1
    result = fit(held_out_views(model, 1).observation, seed=0)
    assert torch.isfinite(result.energy).all()


def test_a_missing_recipe_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no recipe .*gone\.yaml"):
        fit_of(tmp_path / "gone.yaml", load("laptop"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"energy": 1.0}, "'energy' is not accepted"),
        ({"num_starts": "many"}, "num_starts"),
        ({"weights": {"gone": 1.0}}, "gone"),
        ({"optimizer": "kfit.energies.L1"}, "optimizer"),
    ],
)
def test_a_wrong_recipe_gets_one_sentence(tmp_path, change, message):
    recipe = yaml.safe_load(RELEASED.read_text())
    recipe["energies"] = {"perceptual": {"class_path": "kfit.energies.L1"}, "prior": "kfit.energies.CodePrior"}
    (tmp_path / "wrong.yaml").write_text(yaml.safe_dump(recipe | change))
    with pytest.raises(ValueError, match=message) as error:
        fit_of(tmp_path / "wrong.yaml", load("laptop"))
    assert "\n" not in str(error.value)


def test_what_a_part_says_against_its_settings_is_passed_on(tmp_path):
    with pytest.raises(ValueError, match="weights: there is no file"):
        fit_of(RELEASED, load("laptop"), [f"{NETWORK}.init_args.weights", str(tmp_path / "gone.pth")])


def test_what_a_fit_writes_is_read_as_the_same_fit(tmp_path):
    model, file = load("laptop"), tmp_path / "again.yaml"
    fit = fit_of(RELEASED, model, [*OFFLINE, "--num_starts", "3"])
    file.write_text(fit.to_yaml(), encoding="utf-8")
    again = fit_of(file, model)
    assert again.to_yaml() == fit.to_yaml()
    assert again.num_starts == 3
    assert isinstance(again.initializers[-1], EncoderPosterior)
