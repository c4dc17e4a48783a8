"""Training: the objective, a few steps of it, what it writes down, and once the whole path by the command line."""

import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from lightning.pytorch import Trainer
from lightning.pytorch.loggers import CSVLogger
from skimage.metrics import structural_similarity
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import nn
from torch.distributions import Normal, kl_divergence
from torch.utils.data import DataLoader, Dataset

import kfit
from kfit.core import Energy, Rendering
from kfit.energies import L1, Perceptual, Silhouette
from kfit.generators import VAE3D, ConvEncoder, ExtentsHead, RadianceField, RotationHead
from kfit.training import ConditionalVAE, RandomSimilarity

ROOT = Path(__file__).parents[2]
# What Lightning says about batches that come from memory, and calls in torch that has called it deprecated since.
quiet = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)
SIDE = 16


def features():
    torch.manual_seed(9)
    return nn.Sequential(nn.Conv2d(3, 4, 3, 2, 1), nn.BatchNorm2d(4), nn.Softplus())


def build(**changes):
    torch.manual_seed(4)
    settings = {
        "generator": VAE3D(4, (4, 3), 4, (3,)),
        "encoder": ConvEncoder(4, (8, 8), 8, SIDE),
        "extents": ExtentsHead(4, 8),
        "losses": {"image": L1(), "mask": Silhouette()},
        "loss_weights": {"mask": 0.2},
        "kl_weight": 0.01,
        "extents_weight": 0.3,
        "rate": 0.01,
    }
    return ConditionalVAE(**settings | changes)


def batch(rows=4, seed=0):
    rng = torch.Generator().manual_seed(seed)
    mask = (torch.rand(rows, 1, SIDE, SIDE, generator=rng) > 0.5).float()
    return {
        "source": torch.rand(rows, 3, SIDE, SIDE, generator=rng),
        "target": torch.rand(rows, 3, SIDE, SIDE, generator=rng),
        "target_mask": mask,
        "target_depth": 0.1 * mask,
        "azimuth": torch.rand(rows, generator=rng),
        "elevation": torch.rand(rows, generator=rng),
        "extents": torch.nn.functional.normalize(torch.rand(rows, 3, generator=rng), dim=1),
    }


class Batches(Dataset):
    """Whole batches, one an item."""

    def __init__(self, count=3, without=()):
        self.count, self.without = count, without

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        return {name: tensor for name, tensor in batch(seed=index).items() if name not in self.without}


def loader(**settings):
    return DataLoader(Batches(**settings), batch_size=None)


def trainer(tmp_path, **settings):
    silent = dict.fromkeys(("logger", "enable_checkpointing", "enable_progress_bar", "enable_model_summary"), False)
    small = {"max_steps": 3, "log_every_n_steps": 1, "accelerator": "cpu", "default_root_dir": tmp_path}
    return Trainer(**silent | small | settings)


@pytest.fixture
def logged(monkeypatch):
    """Collects what a step without a trainer writes down."""
    kept = {}
    monkeypatch.setattr(ConditionalVAE, "log", lambda self, name, value, **_: kept.update({name: float(value)}))
    monkeypatch.setattr(
        ConditionalVAE, "log_dict", lambda self, values, **_: kept.update({k: float(v) for k, v in values.items()})
    )
    return kept


class TestTheLoss:
    def test_is_the_formula(self, logged):
        module, sample = build(), batch()
        torch.manual_seed(11)
        loss = module.training_step(sample, 0)

        torch.manual_seed(11)
        mean, log_variance = module.encoder(sample["source"])
        posterior = Normal(mean, (0.5 * log_variance).exp())
        code = posterior.rsample()
        drawn = module.generator(code=code, azimuth=sample["azimuth"], elevation=sample["elevation"])
        image = (drawn.image - sample["target"]).abs().mean()
        mask = (drawn.mask - sample["target_mask"]).square().mean()
        extents = (module.extents(code) - sample["extents"]).abs().mean()
        divergence = kl_divergence(posterior, Normal(0.0, 1.0)).sum(1).mean()
        torch.testing.assert_close(loss, image + 0.2 * mask + 0.3 * extents + 0.01 * divergence)
        expected = {"image": image, "mask": mask, "extents": extents, "kl": divergence, "loss": loss}
        assert logged == {f"train/{name}": pytest.approx(float(value.detach())) for name, value in expected.items()}

    def test_counts_the_divergence_in_nats_summed_over_the_code(self, logged):
        class Certain(ConvEncoder):
            def forward(self, image):
                mean = torch.tensor([[1.0, 0.0, 0.0, -2.0]]).expand(len(image), 4)
                return mean, torch.tensor([[0.0, math.log(4.0), 0.0, 0.0]]).expand(len(image), 4)

        build(encoder=Certain()).training_step(batch(), 0)
        # ½ (1 + 4) of the means and ½ (4 − 1 − ln 4) of the one spread.
        assert logged["train/kl"] == pytest.approx(2.5 + 0.80685282, abs=1e-6)

    def test_of_validation_is_drawn_from_the_mean_code(self, logged):
        module, sample = build().eval(), batch()
        with torch.no_grad():
            module.validation_step(sample, 0)
            drawn = module(sample["source"], sample["azimuth"], sample["elevation"])
        away = (drawn.image - sample["target"]).abs().mean().item()
        assert [logged["val/l1"], logged["val/image"]] == pytest.approx([away, away])
        assert set(logged) == {f"val/{name}" for name in ("l1", "image", "mask", "extents", "ssim", "mask_iou")}

    def test_of_a_drawing_without_fault_is_nothing_and_masks_count_by_their_shared_part(self, logged, monkeypatch):
        module, sample = build().eval(), batch()
        true = torch.zeros(4, 1, SIDE, SIDE)
        true[:, :, :8], sample["target_mask"] = 1, true
        output = true.clone()
        output[0, :, 4:] = 0  # half of it, and nothing else
        output[1, :, :12] = 1  # it, and half as much again
        monkeypatch.setattr(module, "forward", lambda *args: Rendering(sample["target"], output))
        with torch.no_grad():
            module.validation_step(sample, 0)
        assert logged["val/l1"] == 0
        assert logged["val/ssim"] == pytest.approx(1)
        assert logged["val/mask_iou"] == pytest.approx((1 / 2 + 2 / 3 + 1 + 1) / 4)

    def test_has_the_structural_similarity_of_scikit_image(self, logged, monkeypatch):
        module, sample = build().eval(), batch()
        drawn = (sample["target"] + 0.3 * sample["source"]).clamp(0, 1)
        monkeypatch.setattr(module, "forward", lambda *args: Rendering(drawn))
        monkeypatch.setattr(module, "_compare", lambda *args: {})
        with torch.no_grad():
            module.validation_step(sample, 0)
        settings = {"data_range": 1, "channel_axis": 0, "gaussian_weights": True, "use_sample_covariance": False}
        one = [structural_similarity(a.numpy(), b.numpy(), **settings) for a, b in zip(drawn, sample["target"])]  # noqa: B905
        assert logged["val/ssim"] == pytest.approx(sum(one) / 4, abs=0.01)
        assert "val/mask_iou" not in logged

    def test_reaches_generator_encoder_and_extents(self):
        module = build()
        module.log = module.log_dict = lambda *args, **settings: None
        module.training_step(batch(), 0).backward()
        for name in ("generator", "encoder", "extents"):
            slopes = [p.grad for p in getattr(module, name).parameters()]
            assert all(slope is not None and bool(slope.isfinite().all()) for slope in slopes), name
            assert sum(float(slope.abs().sum()) for slope in slopes) > 0, name

    def test_does_without_extents_and_depth_where_the_batch_has_none(self, logged):
        sample = {name: value for name, value in batch().items() if name not in ("extents", "target_depth")}
        module = build()
        with torch.no_grad():
            assert module.training_step(sample, 0).isfinite()
            module.validation_step(sample, 0)
        assert not any("extents" in name for name in logged)

    def test_shows_the_encoder_the_jittered_view_only_while_training(self, logged, monkeypatch):
        module, sample, recorded = build(similarity=RandomSimilarity(0.0, 0.0, 1.0)), batch(), []
        monkeypatch.setattr(module, "similarity", lambda image: recorded.append(image) or image)
        with torch.no_grad():
            module.training_step(sample, 0)
            module.validation_step(sample, 0)
        assert len(recorded) == 1
        assert recorded[0] is sample["source"]

    def test_shows_the_encoder_a_photograph_of_the_view_jittered(self, logged):
        module, sample, recorded = build(), batch(), []
        sample["source_mask"] = sample["source"][:, :1]
        module.photometric = lambda image, mask: image * mask
        module.similarity = lambda image: recorded.append(image) or image
        with torch.no_grad():
            module.training_step(sample, 0)
        torch.testing.assert_close(recorded[0], sample["source"] * sample["source_mask"])


class TestLossNetworks:
    @quiet
    def test_given_are_not_trained_and_stay_in_evaluation_mode(self, tmp_path):
        class Raw(Energy):
            """Somebody's energy that has forgotten to freeze its network."""

            def __init__(self):
                super().__init__()
                self.network = features()

            def compare(self, prediction, prepared):
                return (self.network(prediction) - self.network(prepared["target"])).square().mean((1, 2, 3))

        raw = Raw()
        module = build(losses={"features": Perceptual(features()), "raw": raw}, loss_weights=None)
        before = {name: value.clone() for name, value in module.losses.state_dict().items()}
        trainer(tmp_path).fit(module, loader(), loader())
        after = module.losses.state_dict()
        assert all(torch.equal(after[name], value) for name, value in before.items())
        assert not any(p.requires_grad for p in module.losses.parameters())
        assert not any(part.training for part in module.losses["raw"].modules())
        assert all(p.requires_grad and p.grad is None for p in raw.parameters())


class TestTraining:
    @quiet
    def test_moves_all_networks_and_ends_with_finite_numbers(self, tmp_path):
        module = build()
        before = {name: p.detach().clone() for name, p in module.named_parameters()}
        runner = trainer(tmp_path)
        runner.fit(module, loader(), loader())
        assert runner.global_step == 3
        assert math.isfinite(runner.callback_metrics["train/loss"])
        for name, p in module.named_parameters():
            assert bool(p.isfinite().all()), name
            assert not torch.equal(p, before[name]), name

    @pytest.mark.slow
    @quiet
    def test_brings_the_loss_down_on_what_it_sees_again_and_again(self, tmp_path):
        module, losses = build(losses={"image": L1()}, loss_weights=None, kl_weight=0.0), []
        step = module.training_step
        module.training_step = lambda *args: losses.append(step(*args)) or losses[-1]
        trainer(tmp_path, max_steps=40).fit(module, loader(count=1), loader())
        assert sum(losses[-5:]) < 0.9 * sum(losses[:5])

    @quiet
    def test_runs_through_validation(self, tmp_path):
        runner = trainer(tmp_path, fast_dev_run=True)
        runner.fit(build(), loader(), loader())
        assert {"val/l1", "val/image", "val/mask", "val/extents"} <= set(runner.callback_metrics)

    @quiet
    def test_goes_on_from_a_checkpoint_for_more_steps_than_were_planned(self, tmp_path):
        first = trainer(tmp_path, max_steps=3)
        first.fit(build(), loader(), loader())
        first.save_checkpoint(tmp_path / "three.ckpt")
        further = trainer(tmp_path, max_steps=9)
        further.fit(build(), loader(), loader(), ckpt_path=tmp_path / "three.ckpt", weights_only=True)
        assert further.global_step == 9

    @quiet
    @pytest.mark.parametrize("total", [1, 2, 20, 40, 57])
    def test_rate_rises_over_a_twentieth_of_the_steps_and_falls_as_a_cosine(self, tmp_path, total, monkeypatch):
        monkeypatch.setattr(Trainer, "estimated_stepping_batches", total)
        module, rates = build(), []
        module.trainer = trainer(tmp_path)
        configured = module.configure_optimizers()
        for _ in range(total):
            rates.append(configured["optimizer"].param_groups[0]["lr"])
            configured["optimizer"].step()
            configured["lr_scheduler"]["scheduler"].step()
        rise = max(1, total // 20)
        assert max(rates) <= 0.01
        assert all(a < b for a, b in pairwise(rates[:rise]))
        if total > 1:
            assert rates[rise] == 0.01
            middle = rise + (total - rise) // 2
            share = (1 + math.cos(math.pi * (middle - rise) / (total - rise))) / 2
            assert rates[middle] == pytest.approx(0.01 * share)

    @quiet
    def test_without_an_end_is_an_error_in_a_sentence(self, tmp_path):
        with pytest.raises(ValueError, match="the trainer needs max_epochs or max_steps"):
            trainer(tmp_path, max_steps=-1, max_epochs=-1).fit(build(), loader(), loader())

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            (
                {"losses": {"kl": L1()}, "loss_weights": None},
                "the name kl is reserved for the log, which uses extents, kl, l1, loss",
            ),
            ({"losses": {"ssim": L1()}, "loss_weights": None}, "losses: the name ssim is reserved for the log"),
        ],
    )
    def test_mistakes_in_the_losses_names_are_reported_when_it_is_built(self, changes, message):
        with pytest.raises(ValueError, match=message):
            build(**changes)


class TestCheckpoint:
    @quiet
    def test_of_networks_built_in_python_loads_as_data_alone(self, tmp_path):
        module = build(similarity=RandomSimilarity())
        runner = trainer(tmp_path, logger=CSVLogger(tmp_path))
        runner.fit(module, loader(), loader())
        runner.save_checkpoint(tmp_path / "all.ckpt")
        saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
        assert dict(saved["hyper_parameters"]) == {
            "loss_weights": {"mask": 0.2}, "kl_weight": 0.01, "extents_weight": 0.3, "rate": 0.01, "compile": False,
            "pixel_stride": 1, "photometric": None, "symmetry": "none", "optimizer": None, "scheduler": None,
        }  # fmt: skip
        again = build()
        again.load_state_dict(saved["state_dict"])
        torch.testing.assert_close(again.generator.constant, module.generator.constant)

    @pytest.mark.parametrize("similarity", [None, RandomSimilarity()])
    def test_leaves_no_network_among_the_hyperparameters(self, similarity):
        module = build(similarity=similarity)
        plain = {"loss_weights", "kl_weight", "extents_weight", "rate", "compile", "pixel_stride", "photometric"}
        plain |= {"symmetry", "optimizer", "scheduler"} | (set() if similarity else {"similarity"})
        assert set(module.hparams) == set(module.hparams_initial) == plain


@pytest.mark.slow
def test_the_command_line_trains_goes_on_and_packs(tmp_path):
    modules = {"lightning": "kfit.training.lightning_cli", "main": "kfit.cli.main"}

    def run(command, *words):
        code = f"from {modules[command]} import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, words)], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr[-3000:]
        return done

    fit = [
        "fit", "-c", ROOT / "recipes" / "smoke.yaml", "--trainer.accelerator", "cpu", "--trainer.enable_progress_bar",
        "false", "--trainer.default_root_dir", tmp_path, "--data.num_objects", 4, "--data.num_views", 4,
        "--data.num_val_objects", 2, "--data.batch_size", 4, "--data.cache_dir", tmp_path / "cache",
    ]  # fmt: skip
    run("lightning", *fit, "--trainer.max_epochs", 1)
    (first,) = tmp_path.rglob("last.ckpt")
    assert torch.load(first, weights_only=True)["epoch"] == 0
    run("lightning", *fit, "--trainer.max_epochs", 2, "--ckpt_path", first)
    assert list(tmp_path.rglob("last.ckpt")) == [first]  # a run that goes on writes to its own folder
    assert torch.load(first, weights_only=True)["global_step"] == 8
    log = EventAccumulator(str(first.parents[1])).Reload()
    assert len(log.Images("pictures")) == len(log.Scalars("val/l1")) == 2
    heads = [*fit[:2], ROOT / "recipes" / "pose_head.yaml", *fit[3:]]
    heads[heads.index(tmp_path)] = tmp_path / "head"
    run("lightning", *heads, "--trainer.max_epochs", 1, "--model.init_args.compile", "false")
    (head,) = (tmp_path / "head").rglob("last.ckpt")
    run("main", "pack", first, "--pose-head", head, "--out", tmp_path / "mug.safetensors")
    model = kfit.load(tmp_path / "mug.safetensors")
    assert isinstance(model.pose_head, RotationHead)
    assert model.card.training["pose_head"]["steps"] == 4


def test_a_step_on_thinned_pixels_has_on_average_the_loss_of_the_whole_step(monkeypatch):
    field = RadianceField(4, (4, 3), 4, image_size=SIDE, refined=False)
    model = build(generator=field, pixel_stride=2)
    plain = build(generator=field, encoder=model.encoder, extents=model.extents)
    for one in (model, plain):
        monkeypatch.setattr(one, "log", lambda *args, **kwargs: None)
        monkeypatch.setattr(one, "log_dict", lambda *args, **kwargs: None)
    drawn = []
    picture = field._picture
    monkeypatch.setattr(field, "_picture", lambda *args: drawn.append(tuple(args[2].shape)) or picture(*args))
    monkeypatch.setattr(torch, "randn_like", torch.zeros_like)
    losses = []
    for at in ([[0], [0]], [[0], [1]], [[1], [0]], [[1], [1]]):
        monkeypatch.setattr(torch, "randint", lambda *args, at=at: torch.tensor(at))
        losses.append(model.training_step(batch(), 0))
    whole = plain.training_step(batch(), 0)
    assert drawn == [(8, 8, 3)] * 4 + [(16, 16, 3)]
    torch.testing.assert_close(sum(losses) / 4, whole)


def test_views_are_drawn_from_the_distances_at_which_they_were_taken(monkeypatch):
    field = RadianceField(4, (4, 3), 4, image_size=SIDE, refined=False, unit_fraction=1.1)
    model, recorded, picture = build(generator=field), [], field._picture
    monkeypatch.setattr(model, "log", lambda *args, **kwargs: None)
    monkeypatch.setattr(model, "log_dict", lambda *args, **kwargs: None)
    monkeypatch.setattr(field, "_picture", lambda *args: recorded.append(args[1].get("focal")) or picture(*args))
    distance = torch.linspace(1.3, 8.0, len(batch()["azimuth"]))
    model.training_step(batch() | {"distance": distance}, 0)
    model.report(batch() | {"distance": distance}, "val")
    model.training_step(batch(), 0)
    for focal in recorded[:2]:
        torch.testing.assert_close(focal, 1.1 * (distance.square() - 1 / 4).sqrt())
    assert recorded[2] is None


def test_a_generator_of_whole_pictures_cannot_be_thinned():
    with pytest.raises(ValueError, match=r"pixel_stride: VAE3D draws whole pictures only, so it must be 1, got 2"):
        build(pixel_stride=2)
