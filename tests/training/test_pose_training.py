"""Teaching a pose head: all views are shown, disturbed in training alone, and a few steps of it lessen the loss."""

import math

import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from kfit.generators import PoseHead
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.training import PoseTraining, RandomRecolor

SIDE = 16
ANGLES = ("source_azimuth", "source_elevation", "azimuth", "elevation")
quiet = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)


def build(**changes):
    torch.manual_seed(0)
    return PoseTraining(PoseHead(channels=(8, 8), hidden_dim=8, image_size=SIDE), **changes)


def batch(rows=4, seed=0):
    rng = torch.Generator().manual_seed(seed)
    views = {name: torch.rand(rows, 3, SIDE, SIDE, generator=rng) for name in ("source", "target")}
    return views | {name: torch.rand(rows, generator=rng) for name in ANGLES}


def distance(module, given):
    with torch.no_grad():
        said = module.eval()(given["source"])
    module.train()
    return float(module.pose_head.divergence(said, given["source_azimuth"], given["source_elevation"]).mean())


@pytest.fixture
def logged(monkeypatch):
    told = {}
    monkeypatch.setattr(PoseTraining, "log", lambda self, name, value, **settings: told.update({name: float(value)}))
    return told


def test_the_loss_is_the_mean_divergence_of_sources_and_targets(logged):
    module, given = build().eval(), batch()
    head = module.pose_head
    with torch.no_grad():
        loss = module.training_step(given, 0)
        one = head.divergence(head(given["source"]), given["source_azimuth"], given["source_elevation"])
        other = head.divergence(head(given["target"]), given["azimuth"], given["elevation"])
        module.validation_step(given, 0)
    torch.testing.assert_close(loss, torch.cat([one, other]).mean())
    assert logged == {"train/pose": pytest.approx(float(loss)), "val/pose": pytest.approx(float(loss))}


@pytest.mark.parametrize(("symmetry", "median"), [("none", 25.0), ("y", 5.0)])
def test_the_likeliest_pose_is_judged_by_itself_and_by_the_axis_where_azimuth_is_free(logged, symmetry, median):
    class Says(PoseHead):
        """Is sure of one bin, whatever it sees."""

        def forward(self, image):
            share = torch.full((len(image), len(self.azimuths), len(self.elevations)), -1e3)
            share[:, len(self.azimuths) // 2, 4] = 0  # azimuth 5°, elevation 30°
            return share

    module = PoseTraining(Says(symmetry, channels=(8, 8), hidden_dim=8, image_size=SIDE)).eval()
    given = batch(rows=3)
    given |= {name: torch.full((3,), math.radians(35)) for name in ANGLES if "elevation" in name}
    given |= {name: torch.full((3,), math.radians(30)) for name in ANGLES if "azimuth" in name}
    with torch.no_grad():
        module.test_step(given, 0)
        module.on_test_epoch_end()
    said, truth = (
        rotation_from_angles(*torch.tensor(angles).deg2rad(), torch.tensor(0.0)) for angles in ((5, 30), (30, 35))
    )
    away = float(rotation_error(said, truth, symmetry).rad2deg())
    assert away == pytest.approx(median, rel=0.2)
    assert logged["test/rotation_deg"] == pytest.approx(away, abs=0.01)
    assert (logged["test/within_10deg"], logged["test/within_30deg"]) == (float(away < 10), 1.0)


def test_errors_of_one_validation_do_not_count_in_the_next(logged):
    module = build().eval()
    turn = torch.eye(3).expand(2, 3, 3)
    for azimuth in (1.0, 0.0):
        module.evaluate_rotations(turn, torch.full((2,), azimuth), torch.zeros(2), "none")
        module.on_validation_epoch_end()
    assert logged["val/rotation_deg"] == pytest.approx(0, abs=1e-4)
    module.evaluate_rotations(turn * torch.nan, torch.zeros(2), torch.zeros(2), "none")
    module.on_validation_epoch_end()
    assert logged["val/rotation_deg"] == 180


def test_views_are_recoloured_then_turned_in_training_alone(logged):
    seen = []
    module = build(recolor=lambda image: image / 2, jitter=lambda image: 1 - image).eval()
    module.pose_head.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    given = batch()
    with torch.no_grad():
        module.training_step(given, 0)
        module.validation_step(given, 0)
    shown = torch.cat([given["source"], given["target"]])
    torch.testing.assert_close(seen[0], 1 - shown / 2)
    torch.testing.assert_close(seen[1], shown)


def test_half_of_the_views_are_mirrored_with_their_azimuths(logged, monkeypatch):
    seen = []
    module, given = build(mirror=True).eval(), batch(rows=64)

    def divergence(said, azimuth, elevation):
        seen.append((azimuth, elevation))
        return said.sum((1, 2))

    monkeypatch.setattr(module.pose_head, "divergence", divergence)
    module.pose_head.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    with torch.no_grad():
        module.training_step(given, 0)
    image, (azimuth, elevation) = seen
    shown, told = (torch.cat([given[one], given[other]]) for one, other in (("source", "target"), ANGLES[::2]))
    mirrored = (image == shown.flip(3)).flatten(1).all(1)
    assert 40 < int(mirrored.sum()) < 88
    torch.testing.assert_close(image[~mirrored], shown[~mirrored])
    torch.testing.assert_close(azimuth, torch.where(mirrored, torch.pi - told, told))
    torch.testing.assert_close(elevation, torch.cat([given[name] for name in ANGLES[1::2]]))


def test_a_view_in_a_mirror_is_the_mirrored_object_from_the_mirrored_side():
    # A handle at +x is seen at the right from α, at the left from π − α, as far from the middle.
    across = rotation_from_angles(torch.tensor([0.4, math.pi - 0.4]), torch.full((2,), 0.3), torch.zeros(2))[:, :, 0]
    torch.testing.assert_close(across[0] * torch.tensor([-1.0, 1.0, 1.0]), across[1])


def test_views_are_photographed_by_their_own_masks_first(logged):
    seen = []
    module = build(photograph=lambda image, mask: image * mask, recolor=lambda image: image / 2).eval()
    module.pose_head.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    given = batch()
    masks = {f"{name}_mask": given[name][:, :1] for name in ("source", "target")}
    with torch.no_grad():
        module.training_step(given | masks, 0)
    torch.testing.assert_close(
        seen[0], torch.cat([given[name] * given[name][:, :1] for name in ("source", "target")]) / 2
    )


@quiet
def test_some_steps_lessen_the_loss_and_the_checkpoint_holds_plain_data_alone(tmp_path):
    given = batch()
    module = build(rate=0.01)
    before = distance(module, given)
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=20, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    one = DataLoader([given], batch_size=None)
    trainer.fit(module, one, one)
    assert distance(module, given) < before
    trainer.save_checkpoint(tmp_path / "all.ckpt")
    saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
    assert dict(saved["hyper_parameters"]) == {
        "rate": 0.01, "weight_decay": 1e-3, "jitter": None, "recolor": None, "photograph": None, "mirror": False,
        "compile": False,
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
