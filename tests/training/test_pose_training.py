"""Training a pose head: all views are used, augmented in training alone, and a few steps of it lessen the loss."""

import math

import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from kfit.generators import RotationHead
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.geometry.pose import rotation_of
from kfit.training import PoseTraining, RandomCrop, RandomRecolor
from kfit.training.random_crop import crop_rolled
from tests.fixed_head import FixedHead

SIDE = 16
ANGLES = ("source_azimuth", "source_elevation", "azimuth", "elevation")
quiet = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)


def build(**changes):
    torch.manual_seed(0)
    head = RotationHead(channels=(8, 8), hidden_dim=8, bin_deg=60.0, sigma_deg=25.0, image_size=SIDE)
    return PoseTraining(head, **{"crop": RandomCrop(SIDE), "mirror": False} | changes)


def batch(rows=4, seed=0):
    rng = torch.Generator().manual_seed(seed)
    views = {name: torch.rand(rows, 3, 20, 20, generator=rng) for name in ("source", "target")}
    masks = {f"{name}_mask": torch.ones(rows, 1, 20, 20) for name in ("source", "target")}
    return views | masks | {name: torch.rand(rows, generator=rng) for name in ANGLES}


@pytest.fixture
def logged(monkeypatch):
    entries = {}
    monkeypatch.setattr(PoseTraining, "log", lambda self, name, value, **settings: entries.update({name: float(value)}))
    return entries


@pytest.fixture
def learned(monkeypatch):
    """What `divergence` is called with."""
    calls = []

    def divergence(self, image, azimuth, elevation, roll):
        calls.append((image, azimuth, elevation, roll))
        return image.mean((1, 2, 3)) + 0 * self.roll.bias.sum()

    monkeypatch.setattr(RotationHead, "divergence", divergence)
    return calls


def test_sources_and_targets_are_cropped_and_learned_with_their_rolls(logged, learned):
    module, sample = build(crop=RandomCrop(SIDE, shift=0.0, scale=1.0, hidden=0.0, covered=0.0)), batch()
    loss = module.training_step(sample, 0)
    ((image, azimuth, elevation, roll),) = learned
    views, masks = (torch.cat([sample[f"source{part}"], sample[f"target{part}"]]) for part in ("", "_mask"))
    torch.testing.assert_close(image, crop_rolled(views, masks, roll, SIDE))
    torch.testing.assert_close(azimuth, torch.cat([sample["source_azimuth"], sample["azimuth"]]))
    torch.testing.assert_close(elevation, torch.cat([sample["source_elevation"], sample["elevation"]]))
    assert logged == {"train/pose": pytest.approx(float(loss.detach()))}


@pytest.mark.parametrize("symmetry", ["none", "y"])
def test_validation_measures_the_likeliest_rotation_at_rolls_of_the_whole_circle(logged, symmetry, monkeypatch):
    head = FixedHead(symmetry).certain_of((0, 30, 0))
    module, sample = build(), batch(rows=3)
    monkeypatch.setattr(module, "pose_head", head)
    sample |= {name: torch.full((3,), math.radians(30)) for name in ANGLES if "elevation" in name}
    sample |= {name: torch.zeros(3) for name in ANGLES if "azimuth" in name}
    with torch.no_grad():
        module.test_step(sample, 0)
        module.on_test_epoch_end()
    roll = math.pi * (3 - math.sqrt(5)) * torch.arange(6.0)
    truth, found = (rotation_from_angles(torch.zeros(6), torch.full((6,), math.pi / 6), r) for r in (roll, 0 * roll))
    expected = rotation_error(found, truth, symmetry).rad2deg()
    assert logged["test/rotation_deg"] == pytest.approx(float(expected.quantile(0.5)), abs=1)
    assert logged["test/within_30deg"] == pytest.approx(float((expected < 30).double().mean()))


def test_errors_of_one_validation_do_not_count_in_the_next(logged):
    module = build().eval()
    turn = torch.eye(3).expand(2, 3, 3)
    for azimuth in (1.0, 0.0):
        truth = rotation_of({"azimuth": torch.full((2,), azimuth), "elevation": torch.zeros(2)})
        module.record_rotations(turn, truth, "none")
        module.on_validation_epoch_end()
    assert logged["val/rotation_deg"] == pytest.approx(0, abs=1e-4)
    module.record_rotations(turn * torch.nan, turn, "none")
    module.on_validation_epoch_end()
    assert logged["val/rotation_deg"] == 180


def test_views_are_augmented_as_photos_then_recoloured_then_cropped(logged, learned):
    sample, order = batch(), []

    def part(name):
        def augment(image, mask=None):
            order.append(name)
            return (image[..., :SIDE, :SIDE], torch.zeros(len(image))) if name == "crop" else image

        augment.size = SIDE
        return augment

    module = build(photometric=part("photometric"), recoloring=part("recoloring"), crop=part("crop"))
    module.training_step(sample, 0)
    assert order == ["photometric", "recoloring", "crop"]


def test_half_of_the_views_are_mirrored_with_their_azimuths_and_rolls(logged, learned):
    sample, rolls = batch(rows=64), torch.linspace(-1, 1, 128)
    keep = lambda image, mask: (image, rolls)  # noqa: E731
    module = build(mirror=True, crop=keep)
    module.training_step(sample, 0)
    ((image, azimuth, elevation, roll),) = learned
    views, true = (torch.cat([sample[one], sample[other]]) for one, other in (("source", "target"), ANGLES[::2]))
    mirrored = (image == views.flip(3)).flatten(1).all(1)
    assert 40 < int(mirrored.sum()) < 88
    torch.testing.assert_close(image[~mirrored], views[~mirrored])
    torch.testing.assert_close(azimuth, torch.where(mirrored, torch.pi - true, true))
    torch.testing.assert_close(roll, torch.where(mirrored, -rolls, rolls))
    torch.testing.assert_close(elevation, torch.cat([sample[name] for name in ANGLES[1::2]]))


def test_a_view_in_a_mirror_is_the_mirrored_object_from_the_mirrored_side():
    # A handle at +x is seen at the right from α, at the left from π − α, as far from the middle.
    azimuth, roll = torch.tensor([0.4, math.pi - 0.4]), torch.tensor([0.2, -0.2])
    across = rotation_from_angles(azimuth, torch.full((2,), 0.3), roll)[:, :, 0]
    torch.testing.assert_close(across[0] * torch.tensor([-1.0, 1.0, 1.0]), across[1])


def loss(module, sample):
    with torch.no_grad():
        log_probability = module.eval()(sample["source"][..., :SIDE, :SIDE])
    module.train()
    target = module.pose_head.log_kernel(sample["source_azimuth"], sample["source_elevation"], torch.zeros(4))
    return float((target.exp() * (target - log_probability)).sum(1).mean())


@quiet
def test_some_steps_lessen_the_loss_and_the_checkpoint_holds_plain_data_alone(tmp_path):
    sample = batch()
    module = build(rate=0.01)
    before = loss(module, sample)
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=20, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    one = DataLoader([sample], batch_size=None)
    trainer.fit(module, one, one)
    assert loss(module, sample) < before
    trainer.save_checkpoint(tmp_path / "all.ckpt")
    saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
    assert dict(saved["hyper_parameters"]) == {
        "rate": 0.01, "weight_decay": 1e-3, "recoloring": None, "photometric": None, "mirror": False, "compile": False,
        "optimizer": None, "scheduler": None,
    }  # fmt: skip


@quiet
def test_a_trainer_without_an_end_is_an_error(tmp_path):
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=-1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    one = DataLoader([batch()], batch_size=None)
    with pytest.raises(ValueError, match="needs max_epochs or max_steps"):
        trainer.fit(build(), one, one)


class TestRandomRecolor:
    def test_keeps_white_white_and_stays_in_range(self):
        torch.manual_seed(0)
        image = torch.rand(16, 3, 8, 8)
        image[..., :2] = 1
        found = RandomRecolor()(image)
        torch.testing.assert_close(found[..., :2], image[..., :2])
        assert 0 <= float(found.min()) <= float(found.max()) <= 1

    def test_leaves_about_half_of_the_channels_unmixed_and_of_no_strength_bends_nothing(self):
        torch.manual_seed(0)
        image = torch.rand(400, 3, 4, 4)
        same = (RandomRecolor(gamma=0.0)(image) - image).abs().amax((1, 2, 3)) < 1e-6
        assert 160 < int(same.sum()) < 240

    def test_of_a_negative_strength_is_an_error(self):
        with pytest.raises(ValueError, match="RandomRecolor: gamma"):
            RandomRecolor(-0.1)


def test_validation_runs_the_head_once_for_a_batch(logged, monkeypatch):
    module, rows, forward = build(), [], RotationHead.forward
    monkeypatch.setattr(RotationHead, "forward", lambda head, image: (rows.append(len(image)), forward(head, image))[1])
    with torch.no_grad():
        module.validation_step(batch(rows=3), 0)
    assert rows == [6]
