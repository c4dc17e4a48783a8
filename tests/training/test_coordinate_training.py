"""Teaching the network that reads object coordinates: the truth it is shown, moved with the picture, and its files."""

from pathlib import Path

import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from kfit.baselines import CoordinateRegressor
from kfit.data import build, pose_view
from kfit.models import read_checkpoint
from kfit.training import CoordinateTraining, RandomSimilarity
from kfit.training.coordinate_training import coordinates_of
from kfit.training.lightning_cli import main

SIDE = 32
quiet = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)
POSES = ((0.7, 0.4), (-2.1, 1.2))


def views(category="mug", unit_fraction=1.15, distance=4.0):
    """A batch as `ViewPairs` gives it, and the rasterizer's own coordinates."""
    mesh, light = build(category, 3)
    drawn = [pose_view(mesh, e, a, light, SIDE, distance, unit_fraction) for a, e in POSES]
    azimuth, elevation = torch.tensor(POSES).unbind(1)
    batch = {
        "target": torch.stack([torch.from_numpy(view.image).movedim(-1, 0) for view in drawn]),
        "target_mask": torch.stack([torch.from_numpy(view.mask)[None] for view in drawn]),
        "target_depth": torch.stack(
            [torch.from_numpy((view.depth - distance) * (view.mask > 0))[None] for view in drawn]
        ),
        "azimuth": azimuth,
        "elevation": elevation,
    }
    return batch, torch.stack([torch.from_numpy(view.coords).movedim(-1, 0) for view in drawn])


def make(**changes):
    torch.manual_seed(0)
    return CoordinateTraining(CoordinateRegressor(channels=(4, 8, 8), num_bins=8), unit_fraction=1.15, **changes)


@pytest.mark.parametrize(("unit_fraction", "distance"), [(1.15, 4.0), (0.9, 3.0)])
def test_coordinates_are_those_of_the_rasterizer(unit_fraction, distance):
    batch, truth = views(unit_fraction=unit_fraction, distance=distance)
    angles = batch["azimuth"], batch["elevation"]
    found = coordinates_of(batch["target_depth"], *angles, unit_fraction, distance)
    observed = (batch["target_mask"] > 0).expand_as(truth)
    assert observed.sum() > 600
    torch.testing.assert_close(found[observed], truth[observed], atol=1e-5, rtol=0)


def test_each_row_has_its_own_distance():
    (near, near_truth), (far, far_truth) = views(distance=1.4), views(distance=7.0)
    depth = torch.stack([near["target_depth"][0], far["target_depth"][1]])
    distance = torch.tensor([1.4, 7.0])
    found = coordinates_of(depth, near["azimuth"], near["elevation"], 1.15, distance)
    truth, mask = (
        torch.stack([a[0], b[1]]) for a, b in ((near_truth, far_truth), (near["target_mask"], far["target_mask"]))
    )
    observed = (mask > 0).expand_as(truth)
    torch.testing.assert_close(found[observed], truth[observed], atol=1e-5, rtol=0)


def test_the_loss_is_the_mean_divergence_of_the_targets(monkeypatch):
    logged = {}
    monkeypatch.setattr(CoordinateTraining, "log", lambda self, name, value, **_: logged.update({name: float(value)}))
    module, (sample, truth) = make().eval(), views()
    with torch.no_grad():
        loss = module.training_step(sample, 0)
        module.validation_step(sample, 0)
        expected = module.regressor.divergence(module(sample["target"]), truth, sample["target_mask"]).mean()
    torch.testing.assert_close(loss, expected, atol=1e-4, rtol=0)
    assert logged == {"train/coordinates": pytest.approx(float(loss)), "val/coordinates": pytest.approx(float(loss))}


def test_coordinates_follow_the_jittered_picture(monkeypatch):
    module, (sample, truth) = (
        make(similarity=RandomSimilarity(180.0, 0.3, 1.4), recoloring=lambda image: image / 2),
        views(),
    )
    module.log, shown = lambda *args, **settings: None, {}
    # What is seen are the coordinates themselves, so picture and truth can be compared.
    sample["target"] = truth * (sample["target_mask"] > 0) + 1
    module.regressor.register_forward_pre_hook(lambda _, inputs: shown.update(image=inputs[0]))

    def divergence(logits, coordinates, mask):
        shown.update(truth=coordinates, mask=mask)
        return logits.mean((1, 2, 3, 4))

    monkeypatch.setattr(module.regressor, "divergence", divergence)
    module.recoloring = None
    module.training_step(sample, 0)
    inside = (shown["mask"] > 0.999).expand_as(truth)
    assert inside.sum() > 300
    torch.testing.assert_close(shown["truth"][inside], shown["image"][inside] - 1, atol=1e-3, rtol=0)
    assert not torch.allclose(shown["truth"], truth, atol=0.1)


def test_views_without_depth_are_refused():
    sample = views()[0]
    del sample["target_depth"]
    with pytest.raises(ValueError, match="needs views with depth"):
        make().training_step(sample, 0)


@quiet
def test_some_steps_lessen_the_loss_and_the_checkpoint_holds_plain_data_alone(tmp_path):
    module, (sample, truth) = make(rate=0.01), views()
    one = DataLoader([sample], batch_size=None)
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=25, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(module, one, one)
    with torch.no_grad():
        loss = module.regressor.divergence(module.eval()(sample["target"]), truth, sample["target_mask"]).mean()
    assert loss < 1.8  # ln 8 = 2.08 for a guess
    trainer.save_checkpoint(tmp_path / "all.ckpt")
    saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
    assert dict(saved["hyper_parameters"]) == {
        "rate": 0.01, "weight_decay": 1e-3, "unit_fraction": 1.15, "distance": 4.0, "similarity": None,
        "recoloring": None, "compile": False, "optimizer": None, "scheduler": None,
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
        "trainer.precision": "32-true", "data.category": "can", "data.num_objects": 2, "data.num_views": 2,
        "data.num_val_objects": 1, "data.cache_dir": tmp_path / "cache", "data.batch_size": 2,
    }  # fmt: skip
    recipe = Path(__file__).parents[2] / "recipes/nocs_regressor.yaml"
    main(["fit", "-c", str(recipe), *(str(word) for name, value in words.items() for word in (f"--{name}", value))])
    networks, saved = read_checkpoint(next(tmp_path.rglob("last.ckpt")), ("regressor",))
    assert isinstance(networks["regressor"], CoordinateRegressor)
    assert len(networks["regressor"].turns) == 6
    assert saved["hyper_parameters"]["unit_fraction"] == pytest.approx(1.03)
