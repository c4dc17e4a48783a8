"""Class paths of earlier versions are read wherever a file may name one."""

import json
from importlib import import_module

import pytest
import yaml
from lightning.pytorch import LightningModule

from kfit.fitting import Linear
from kfit.models import load
from kfit.pose.fit_recipe import fit_of
from kfit.pose.model_files import _kind
from kfit.runtime.class_paths import MOVED, current_path, current_paths, current_word
from kfit.training.lightning_cli import _Parser, main


@pytest.mark.parametrize("name", MOVED.values())
def test_what_moved_is_where_the_table_says(name):
    module, _, last = name.rpartition(".")
    try:
        import_module(name)
    except ModuleNotFoundError:
        assert hasattr(import_module(module), last)


def test_names_that_stayed_stay():
    for name in ("kfit.generators.PoseHead", "somebody.schedules.Linear", "kfit.schedules_of_mine.Linear", "mug", ""):
        assert current_path(name) == name


def test_paths_are_found_at_any_depth_of_a_value():
    old = {"a": [{"class_path": "kfit.schedules.Linear", "n": 1}], "b": "kfit.training.Jitter", "c": None}
    new = {"a": [{"class_path": "kfit.fitting.schedules.Linear", "n": 1}], "b": "kfit.training.RandomSimilarity"}
    assert current_paths(old) == {**new, "c": None}


def test_a_recipe_of_a_fit_with_old_paths_is_read(tmp_path):
    recipe = tmp_path / "old.yaml"
    weights = {"image": {"class_path": "kfit.schedules.Linear", "init_args": {"start": 1, "end": 0.5}}}
    adam = {"class_path": "kfit.optimizers.Adam", "init_args": {"rates": 0.01}}
    grid = {"class_path": "kfit.initializers.SphereGrid"}
    place = {"class_path": "kfit.initializers.Constant"}
    place["init_args"] = {"values": {"roll": 0.0, "shift": 0.0, "scale": 1.0}}
    parts = {"energies": {"image": "kfit.energies.L1"}, "initializers": [grid, place], "optimizer": adam}
    recipe.write_text(yaml.safe_dump({**parts, "weights": weights}))
    assert isinstance(fit_of(recipe, load("can")).weights["image"], Linear)


def test_a_card_that_names_an_old_path_finds_its_class(monkeypatch):
    monkeypatch.setitem(MOVED, "kfit.nets.Head", "kfit.generators.PoseHead")
    assert _kind(current_path("kfit.nets.Head")).__name__ == "PoseHead"


def test_a_training_recipe_and_words_with_old_paths_are_read(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["lightning"])
    model = {"class_path": "kfit.training.CoordinateTraining"}
    regressor = {"class_path": "kfit.baselines.CoordinateRegressor"}
    model["init_args"] = {"regressor": regressor, "jitter": "kfit.training.Jitter"}
    recipe = tmp_path / "old.yaml"
    recipe.write_text(json.dumps({"model": model, "data": {"class_path": "kfit.data.ViewsDataModule"}}))
    with pytest.raises(SystemExit):
        main(["fit", "-c", str(recipe), "--model.recolor", "kfit.training.Recolor", "--print_config"])
    written = yaml.safe_load(capsys.readouterr().out)["model"]["init_args"]
    assert written["similarity"]["class_path"] == "kfit.training.RandomSimilarity"
    assert written["recoloring"]["class_path"] == "kfit.training.RandomRecolor"


def test_hyperparameters_of_a_checkpoint_with_old_paths_are_read():
    parser = _Parser(exit_on_error=False)
    parser.add_subclass_arguments(LightningModule, "model")
    regressor = {"class_path": "kfit.baselines.CoordinateRegressor"}
    saved = {"regressor": regressor, "jitter": {"class_path": "kfit.training.Jitter", "init_args": {"roll_deg": 3.0}}}
    read = parser.parse_object({"model": {"class_path": "kfit.training.CoordinateTraining", "init_args": saved}})
    assert read["model.init_args.similarity.class_path"] == "kfit.training.RandomSimilarity"


def test_old_names_of_arguments_are_read_where_they_belong_and_nowhere_else():
    start = {"class_path": "kfit.initializers.Constant", "init_args": {"values": {"spread": 1}, "spread": {"x": 0.1}}}
    other = {"class_path": "somebody.Constant", "init_args": {"spread": 1}}
    assert current_paths([start, other]) == [
        {"class_path": "kfit.initializers.Constant", "init_args": {"values": {"spread": 1}, "sigma": {"x": 0.1}}},
        other,
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("--model.recolor", "--model.recoloring"),
        ("--model.init_args.photograph", "--model.photometric"),
        ("--model.jitter.roll_deg=5", "--model.similarity.roll_deg=5"),
        ("--model.out", "--model.out"),
        ("--data.jitter", "--data.jitter"),
        ("kfit.training.Jitter", "kfit.training.RandomSimilarity"),
    ],
)
def test_old_names_of_arguments_are_read_on_the_command_line(old, new):
    assert current_word(old) == new
