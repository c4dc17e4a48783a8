"""What `lightning` adds to Lightning's command line."""

import csv
import functools
import logging
import math
from pathlib import Path

import pytest
import torch
import yaml
from lightning.pytorch import LightningDataModule, LightningModule, Trainer
from lightning.pytorch.callbacks import EarlyStopping, LearningRateMonitor
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from kfit.geometry import CATEGORIES
from kfit.training import PictureGrid
from kfit.training.lightning_cli import _CLI, main

RECIPES = Path(__file__).parents[2] / "recipes"
# What trains or predicts; the other recipes are of fits.
TRAINED = sorted(path.stem for path in RECIPES.glob("*.yaml") if "\nmodel:\n" in path.read_text())


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    monkeypatch.setattr("sys.argv", ["lightning"])
    # Lightning 2.6 calls jsonargparse by a name that 4.53 has deprecated.
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")


def model_of(*words):
    cli = _CLI(
        LightningModule, LightningDataModule, subclass_mode_model=True, subclass_mode_data=True, run=False,
        auto_configure_optimizers=False, save_config_callback=None,
        args=["--trainer.logger", "false", "--trainer.accelerator", "cpu", *map(str, words)],
    )  # fmt: skip
    return cli.model


@pytest.mark.parametrize("category", ["bowl", "mug"])
def test_the_data_s_category_decides_the_camera_also_in_the_checkpoint(category):
    model = model_of("-c", RECIPES / "radiance_field.yaml", "--data.category", category)
    known = CATEGORIES[category]
    assert float(model.generator.focal) == pytest.approx(known.unit_fraction * math.sqrt(4**2 - 1 / 4))
    torch.testing.assert_close(2 * model.generator.half_sides, torch.tensor(known.sides))
    assert model.hparams["generator"]["init_args"]["sides"] == list(known.sides)
    assert model.hparams["generator"]["init_args"]["unit_fraction"] == known.unit_fraction


@pytest.mark.parametrize("category", ["bowl", "mug"])
def test_the_data_s_category_decides_a_pose_head_s_symmetry_also_in_the_checkpoint(category):
    model = model_of("-c", RECIPES / "pose_head.yaml", "--data.category", category)
    symmetry = CATEGORIES[category].symmetry
    assert model.pose_head.symmetry == symmetry
    assert model.hparams["pose_head"]["init_args"]["symmetry"] == symmetry


def test_meshes_of_one_s_own_may_fill_the_whole_picture():
    model = model_of("-c", RECIPES / "radiance_field.yaml", "--data.category", "mug", "--data.meshes", "shoes")
    torch.testing.assert_close(model.generator.half_sides, torch.full((3,), 0.5))
    assert float(model.generator.focal) == pytest.approx(CATEGORIES["mug"].unit_fraction * math.sqrt(4**2 - 1 / 4))


def test_a_generator_without_a_camera_is_left_as_it_is():
    model = model_of("-c", RECIPES / "smoke.yaml", "--data.category", "bowl")
    assert "unit_fraction" not in model.hparams["generator"]["init_args"]


@pytest.fixture
def started(monkeypatch, tmp_path):
    """Trainers that a command line has built and would have started."""
    monkeypatch.chdir(tmp_path)
    trainers = []
    for command in ("fit", "test", "predict"):
        whole = getattr(Trainer, command)

        @functools.wraps(whole)
        def begin(trainer, *args, **settings):
            trainers.append(trainer)

        monkeypatch.setattr(Trainer, command, begin)
    return trainers


def start(command, recipe, *words):
    main([command, "-c", str(RECIPES / f"{recipe}.yaml"), "--trainer.accelerator", "cpu", *map(str, words)])


def kinds(parts):
    return [type(part) for part in parts]


@pytest.mark.parametrize(
    ("recipe", "grids"), [("smoke", 1), ("pose_head", 0), pytest.param("radiance_field", 1, marks=pytest.mark.slow)]
)
def test_a_training_logs_rate_and_pictures_into_tensorboard_and_a_table(started, recipe, grids):
    start("fit", recipe)
    (trainer,) = started
    assert kinds(trainer.loggers) == [CSVLogger, TensorBoardLogger]
    assert len({Path(logger.log_dir).resolve() for logger in trainer.loggers}) == 1
    assert Path(trainer.log_dir).resolve() == Path.cwd() / "lightning_logs" / "version_0"
    assert kinds(trainer.callbacks).count(PictureGrid) == grids
    assert kinds(trainer.callbacks).count(LearningRateMonitor) == 1


def test_a_logger_by_name_wins_and_gets_pictures_and_rate(started):
    start("fit", "smoke", "--trainer.logger", "CSVLogger", "--trainer.logger.save_dir", "own")
    (trainer,) = started
    assert kinds(trainer.loggers) == [CSVLogger]
    assert {PictureGrid, LearningRateMonitor} <= set(kinds(trainer.callbacks))


def test_without_a_logger_nothing_is_logged(started):
    start("fit", "smoke", "--trainer.logger", "false")
    (trainer,) = started
    assert trainer.loggers == []
    assert not {PictureGrid, LearningRateMonitor} & set(kinds(trainer.callbacks))


def test_pictures_by_name_win(started):
    start("fit", "smoke", "--trainer.callbacks+=kfit.training.PictureGrid", "--trainer.callbacks.num_objects", 2)
    (grid,) = (callback for callback in started[0].callbacks if isinstance(callback, PictureGrid))
    assert grid.num_objects == 2


def test_a_test_logs_but_shows_no_pictures_and_a_prediction_makes_nothing(started):
    start("test", "smoke")
    start("predict", "fit_dataset", "--data.root", "nocs")
    tested, predicted = started
    assert kinds(tested.loggers) == [CSVLogger, TensorBoardLogger]
    assert not {PictureGrid, LearningRateMonitor} & set(kinds(tested.callbacks))
    assert predicted.loggers == []


def test_the_data_s_category_decides_by_what_rotations_a_test_counts(started):
    start("test", "smoke", "--data.category", "bowl")
    assert model_of("-c", RECIPES / "smoke.yaml", "--data.category", "bowl").symmetry == "y"
    assert model_of("-c", RECIPES / "smoke.yaml").symmetry == "none"


@pytest.mark.slow
@pytest.mark.parametrize("recipe", TRAINED)
def test_a_printed_recipe_gives_the_same_run(recipe, capsys, tmp_path):
    command = "predict" if recipe == "fit_dataset" else "fit"

    def printed(path):
        with pytest.raises(SystemExit) as ended:
            main([command, "-c", str(path), "--print_config"])
        assert ended.value.code == 0
        return capsys.readouterr().out

    first = printed(RECIPES / f"{recipe}.yaml")
    (tmp_path / "printed.yaml").write_text(first)
    assert printed(tmp_path / "printed.yaml") == first
    messages, written = yaml.safe_load(first), yaml.safe_load((RECIPES / f"{recipe}.yaml").read_text())
    assert messages["model"]["class_path"] == written["model"]["class_path"]
    assert len(messages["trainer"]["callbacks"] or []) == len(written["trainer"].get("callbacks", []))


def test_the_recipes_that_train_are_known():
    assert {
        "fit_dataset",
        "nocs_regressor",
        "pose_head",
        "radiance_field",
        "refiner",
        "regressor",
        "smoke",
        "vae3d",
    } <= {*TRAINED}
    assert "fit_released" not in TRAINED


@pytest.fixture
def messages():
    """Words that Lightning logs."""
    recorded, logger = [], logging.getLogger("lightning.pytorch.utilities.rank_zero")
    handler = logging.Handler()
    handler.emit = lambda record: recorded.append(record.getMessage())
    logger.addHandler(handler)
    yield recorded
    logger.removeHandler(handler)


SMALL = (
    "--model.generator.volume_dims", "[8,8,4]", "--model.generator.projection_dim", 8,
    "--model.generator.decoder_dims", "[8,8]", "--model.encoder.channels", "[8,8,8,8]",
    "--data.num_objects", 2, "--data.num_views", 2, "--data.num_val_objects", 1, "--data.batch_size", 2,
    "--trainer.enable_progress_bar", "false", "--trainer.log_every_n_steps", 1, "--trainer.precision", "32-true",
)  # fmt: skip


@pytest.mark.slow
def test_a_training_stops_early_and_is_validated_and_tested_without_noise(monkeypatch, tmp_path, messages, capsys):
    monkeypatch.chdir(tmp_path)
    stop = ("--trainer.callbacks+=EarlyStopping", "--trainer.callbacks.monitor", "val/l1")
    never = ("--trainer.callbacks.patience", 1, "--trainer.callbacks.min_delta", 1)
    trainers, whole = [], Trainer.fit

    @functools.wraps(whole)
    def fit(trainer, *args, **settings):
        trainers.append(trainer)
        return whole(trainer, *args, **settings)

    monkeypatch.setattr(Trainer, "fit", fit)
    # Warnings are errors here, so that it says none.
    start("fit", "smoke", *SMALL, *stop, *never, "--trainer.max_epochs", 4)
    (trainer,) = trainers
    assert trainer.current_epoch == 2
    assert [type(one) for one in trainer.callbacks].count(EarlyStopping) == 1
    assert messages
    assert not [line for line in messages if "Tip" in line]

    run = tmp_path / "lightning_logs" / "version_0"
    assert {path.name for path in run.glob("checkpoints/*")} == {"best.ckpt", "last.ckpt"}
    assert not list(run.rglob("*.png"))
    log = EventAccumulator(str(run)).Reload()
    assert len(log.Images("pictures")) == len(log.Scalars("val/l1")) == 2
    with (run / "metrics.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert {"val/l1", "val/ssim", "val/mask_iou", "val/extents", "lr-AdamW"} <= set(rows[0])
    assert sum(bool(row["val/l1"]) for row in rows) == 2

    for command in ("validate", "test"):
        capsys.readouterr()
        start(command, "smoke", *SMALL, "--ckpt_path", run / "checkpoints" / "last.ckpt")
        shown = capsys.readouterr().out
        assert "val/l1" in shown if command == "validate" else "test/rotation_deg" in shown
    files = {path.name for path in (tmp_path / ".kfit_cache").iterdir()}
    assert {name.split("_")[1] for name in files} == {"train", "val", "test"}
