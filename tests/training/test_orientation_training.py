"""Teaching the VGG16 baseline: all views are shown, disturbed in training alone, and its checkpoint gives it back."""

from pathlib import Path

import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from kfit.baselines import OrientationRegressor
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.models import read_checkpoint
from kfit.training import OrientationTraining, RandomCorruption, RandomSimilarity
from kfit.training.lightning_cli import main

SIDE = 32
quiet = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)


def build(**changes):
    torch.manual_seed(0)
    return OrientationTraining(OrientationRegressor(hidden_dim=8, image_size=SIDE), **changes)


def batch(rows=3, seed=0):
    rng = torch.Generator().manual_seed(seed)
    views = {name: torch.rand(rows, 3, SIDE, SIDE, generator=rng) for name in ("source", "target")}
    masks = {name: torch.ones(rows, 1, SIDE, SIDE) for name in ("source_mask", "target_mask")}
    angles = ("source_azimuth", "source_elevation", "azimuth", "elevation")
    return views | masks | {name: torch.rand(rows, generator=rng) for name in angles}


def truth_of(inputs):
    azimuth, elevation = (torch.cat([inputs[f"source_{name}"], inputs[name]]) for name in ("azimuth", "elevation"))
    return rotation_from_angles(azimuth, elevation, torch.zeros(len(azimuth)))


@pytest.fixture
def logged(monkeypatch):
    entries = {}
    monkeypatch.setattr(
        OrientationTraining, "log", lambda self, name, value, **settings: entries.update({name: float(value)})
    )
    return entries


def test_the_loss_is_the_mean_distance_and_the_median_error_is_logged(logged):
    module, sample = build().eval(), batch()
    with torch.no_grad():
        loss = module.training_step(sample, 0)
        module.validation_step(sample, 0)
        module.on_validation_epoch_end()
        output = module(torch.cat([sample["source"], sample["target"]]))
    errors = rotation_error(output, truth_of(sample))
    within = {f"val/within_{limit}deg": (errors.rad2deg() < limit).float().mean() for limit in (10, 30)}
    torch.testing.assert_close(loss, (1 - errors.cos()).mean())
    expected = {"train/rotation": loss, "val/rotation": loss, "val/rotation_deg": errors.rad2deg().quantile(0.5)}
    expected |= within
    assert logged == {name: pytest.approx(float(value)) for name, value in expected.items()}


def test_views_are_scaled_then_disturbed_in_training_alone(logged):
    recorded = []

    def corruption(image, mask):
        recorded.append(mask)
        return image / 2, mask

    module = build(similarity=RandomSimilarity(0.0, 0.0, 1.0), corruption=corruption).eval()
    module.regressor.register_forward_pre_hook(lambda _, inputs: recorded.append(inputs[0]))
    sample = batch()
    with torch.no_grad():
        module.training_step(sample, 0)
        module.validation_step(sample, 0)
    shown = torch.cat([sample["source"], sample["target"]])
    torch.testing.assert_close(recorded[0], torch.ones(6, 1, SIDE, SIDE), atol=1e-4, rtol=0)
    torch.testing.assert_close(recorded[1], shown / 2, atol=1e-4, rtol=0)
    torch.testing.assert_close(recorded[2], shown)


def test_the_mask_follows_the_jitter():
    module = build(
        similarity=RandomSimilarity(0.0, 0.0, 3.0),
        corruption=lambda image, mask: recorded.append((image, mask)) or (image, mask),
    )
    module.log, recorded, sample = lambda *args, **settings: None, [], batch()
    middle = torch.zeros(3, 1, SIDE, SIDE)
    middle[..., 8:24, 8:24] = 1
    sample |= {f"{view}_mask": middle for view in ("source", "target")}
    sample |= {view: (1 - middle).expand(-1, 3, -1, -1) for view in ("source", "target")}
    module.training_step(sample, 0)
    image, mask = recorded[0]
    torch.testing.assert_close(mask, 1 - image[:, :1])
    assert not torch.allclose(mask[0], mask[1])


@quiet
def test_a_step_moves_the_regressor_and_the_checkpoint_holds_plain_data_alone(tmp_path):
    module, one = build(corruption=RandomCorruption()), DataLoader([batch()], batch_size=None)
    before = module.regressor.features[0].weight.detach().clone()
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(module, one, one)
    assert not torch.equal(module.regressor.features[0].weight, before)
    assert 0 <= float(trainer.callback_metrics["val/rotation_deg"]) <= 180
    trainer.save_checkpoint(tmp_path / "all.ckpt")
    saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
    assert dict(saved["hyper_parameters"]) == {
        "rate": 3e-4, "weight_decay": 1e-2, "weights": None, "similarity": None, "compile": False, "optimizer": None,
        "scheduler": None,
    }  # fmt: skip


@pytest.mark.slow
@quiet
@pytest.mark.filterwarnings("ignore:.*")  # of what Lightning says about so short a run
def test_the_recipe_trains_and_its_checkpoint_gives_the_regressor_back(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["lightning"])
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    words = {
        "trainer.max_epochs": 1, "trainer.limit_train_batches": 1, "trainer.accelerator": "cpu",
        "trainer.default_root_dir": tmp_path, "trainer.enable_progress_bar": "false", "model.compile": "false",
        "data.category": "can", "data.num_objects": 2, "data.num_views": 2, "data.num_val_objects": 1,
        "data.cache_dir": tmp_path / "cache", "data.batch_size": 2,
    }  # fmt: skip
    recipe = Path(__file__).parents[2] / "recipes/regressor.yaml"
    main(["fit", "-c", str(recipe), *(str(word) for name, value in words.items() for word in (f"--{name}", value))])
    path = next(tmp_path.rglob("last.ckpt"))
    networks, saved = read_checkpoint(path, ("regressor",))
    assert isinstance(networks["regressor"], OrientationRegressor)
    assert networks["regressor"].symmetry == "y"
    assert saved["datamodule_hyper_parameters"]["category"] == "can"
