"""What users of Lightning expect to choose in a recipe, and what they are told where a choice cannot be."""

import csv
from functools import wraps
from pathlib import Path

import pytest
import torch
import yaml
from lightning.pytorch import Trainer

from kfit.runtime.class_paths import near_class
from kfit.training.lightning_cli import main

RECIPES = Path(__file__).parents[2] / "recipes"
SMALL = (
    "--model.generator.volume_dims", "[8,8,4]", "--model.generator.projection_dim", 8,
    "--model.generator.decoder_dims", "[8,8]", "--model.encoder.channels", "[8,8,8,8]",
    "--data.num_objects", 2, "--data.num_views", 4, "--data.num_val_objects", 1, "--data.batch_size", 2,
    "--trainer.enable_progress_bar", "false", "--trainer.log_every_n_steps", 1, "--trainer.precision", "32-true",
)  # fmt: skip


@pytest.fixture(autouse=True)
def place(monkeypatch, tmp_path):
    monkeypatch.setattr("sys.argv", ["lightning"])
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def trainers(monkeypatch):
    """Trainers that fitted."""
    kept, whole = [], Trainer.fit

    @wraps(whole)  # the command line reads the arguments off it
    def fit(trainer, *args, **settings):
        kept.append(trainer)
        return whole(trainer, *args, **settings)

    monkeypatch.setattr(Trainer, "fit", fit)
    return kept


def train(*words, recipe="smoke", epochs=1):
    command = ["fit", "-c", RECIPES / f"{recipe}.yaml", "--trainer.accelerator", "cpu", "--trainer.max_epochs", epochs]
    main([str(word) for word in (*command, *SMALL, *words)])


def rows_of(run):
    with (run / "metrics.csv").open() as table:
        return list(csv.DictReader(table))


def refused(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        train(*words)
    return ended.value.code, capsys.readouterr().err


@pytest.mark.slow
def test_optimizer_and_scheduler_are_named_by_class_path(trainers, place):
    train(
        *("--model.optimizer", "torch.optim.SGD", "--model.optimizer.lr", 0.01, "--model.optimizer.momentum", 0.5),
        *("--model.scheduler", "torch.optim.lr_scheduler.StepLR", "--model.scheduler.step_size", 1),
    )
    (trainer,) = trainers
    (optimizer,) = trainer.optimizers
    assert isinstance(optimizer, torch.optim.SGD)
    assert optimizer.param_groups[0]["momentum"] == 0.5
    (config,) = trainer.lr_scheduler_configs
    assert (type(config.scheduler), config.interval) == (torch.optim.lr_scheduler.StepLR, "epoch")
    last = place / "lightning_logs" / "version_0" / "checkpoints" / "last.ckpt"
    saved = torch.load(last, weights_only=True)["hyper_parameters"]["optimizer"]
    assert saved["class_path"] == "torch.optim.SGD"
    train("--ckpt_path", last, "--model.optimizer", "torch.optim.SGD", "--model.optimizer.lr", 0.01, epochs=2)


@pytest.mark.slow
def test_a_plateau_s_scheduler_watches_its_measure(trainers):
    plateau = "lightning.pytorch.cli.ReduceLROnPlateau"
    train("--model.scheduler", plateau, "--model.scheduler.monitor", "val/l1")
    (config,) = trainers[0].lr_scheduler_configs
    assert (config.monitor, config.reduce_on_plateau) == ("val/l1", True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Be aware that when using `ckpt_path`", "ignore:Found .* in eval mode")  # by finders
def test_lightning_s_finders_of_rate_and_batch_size_run(trainers):
    train("--trainer.callbacks+=LearningRateFinder", "--trainer.callbacks.attr_name", "rate",
          "--trainer.callbacks.num_training_steps", 20, "--data.num_objects", 12)  # fmt: skip
    assert trainers[0].lightning_module.rate != 2e-3
    train("--trainer.callbacks+=BatchSizeFinder", "--trainer.callbacks.max_trials", 2,
          "--trainer.callbacks.steps_per_trial", 1, "--data.num_objects", 12)  # fmt: skip
    assert trainers[1].datamodule.batch_size > 2


@pytest.mark.slow
def test_bf16_true_trains(trainers):
    train("--trainer.precision", "bf16-true")
    assert next(trainers[0].lightning_module.parameters()).dtype == torch.bfloat16
    assert trainers[0].callback_metrics["val/l1"].isfinite()


@pytest.mark.slow
def test_a_resumed_run_goes_on_in_its_own_folder_and_table(place):
    train(epochs=1)
    run = place / "lightning_logs" / "version_0"
    before = rows_of(run)
    train("--ckpt_path", run / "checkpoints" / "last.ckpt", epochs=2)
    assert [path.name for path in (place / "lightning_logs").iterdir()] == ["version_0"]
    rows = rows_of(run)
    assert len(rows) > len(before)
    epochs = [int(row["epoch"]) for row in rows if row["val/l1"]]
    assert epochs == [0, 1]
    assert {path.name for path in (run / "checkpoints").iterdir()} == {"best.ckpt", "last.ckpt"}


@pytest.mark.slow
def test_a_checkpoint_tells_what_it_came_from(place):
    train()
    saved = torch.load(place / "lightning_logs/version_0/checkpoints/last.ckpt", weights_only=True)["kfit"]
    assert {"kfit", "torch", "code", "data", "seed", "device", "precision"} <= set(saved)
    assert len(saved["data"]) == 16
    assert saved["seed"] == 0
    assert yaml.safe_load(saved["recipe"])["data"]["init_args"]["num_objects"] == 2


@pytest.mark.slow
def test_weights_that_a_recipe_left_behind_are_told_and_weigh_nothing(trainers, capsys):
    train("--model.losses", '{"image": {"class_path": "kfit.energies.L1"}}')
    assert "loss_weights: mask has no effect, as the losses are image" in capsys.readouterr().err
    assert trainers[0].lightning_module.loss_weights == {"image": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--model.generator", "kfit.generators.VEA3D"), 2, "did you mean kfit.generators.VAE3D?"),
        (("--trainer.callbacks+=EarlyStopping", "--trainer.callbacks.monitor", "val/none"), 2, "val/none"),
        (
            ("--model.losses", '{"kl": {"class_path": "kfit.energies.L1"}}'),
            2,
            "the log, which uses extents, kl, l1, loss",
        ),
    ],
)
def test_wrong_choices_are_the_user_s_and_get_a_sentence(capsys, words, code, message):
    ended, text = refused(capsys, *words)
    assert ended == code
    assert message in text
    assert "fault of kfit's" not in text


@pytest.mark.slow
def test_an_error_in_a_callback_of_one_s_own_names_its_file(capsys, place, monkeypatch):
    (place / "own_callbacks.py").write_text(
        "from lightning.pytorch import Callback\n\n\nclass Broken(Callback):\n"
        "    def on_train_start(self, trainer, pl_module):\n        raise AttributeError('no such thing')\n"
    )
    monkeypatch.syspath_prepend(str(place))
    ended, text = refused(capsys, "--trainer.callbacks+=own_callbacks.Broken")
    assert ended == 1
    assert "own_callbacks.py, line 6: AttributeError: no such thing" in text
    assert "fault of kfit's" not in text


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("'kfit.generators.VEA3D' has no such class", "kfit.generators.VAE3D"),
        ("Problem with given class_path 'vae3d':", "kfit.generators.VAE3D"),
        ("kfit.generators.VAE3D is there", None),
        ("no class path at all", None),
    ],
)
def test_a_misspelt_class_has_a_near_one(text, near):
    import kfit.generators  # noqa: F401

    assert near_class(text) == near
