"""Training a refiner: truths that fit the pictures, hypotheses that are off as meant, steps that lessen the loss."""

import math

import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from kfit.features import PoseRefiner
from kfit.generators import ConvEncoder, RadianceField
from kfit.geometry import focal_by_distance, rotation_error, rotation_from_angles
from kfit.geometry.refiner_network import PoseUpdate, rotation_update
from kfit.training import RandomCrop, RefinerTraining
from kfit.training.pose_hypotheses import Hypotheses, random_hypotheses
from kfit.training.random_crop import RolledCrop
from kfit.training.refiner_rows import RefinerMemory, RefinerRows

SIDE = 16


def networks(category):
    sizes = {"code_dim": 4, "volume_dims": [8, 4], "num_samples": 4, "image_size": SIDE, "refined": False}
    with torch.random.fork_rng():
        torch.manual_seed(1)
        return RadianceField(**sizes).eval(), ConvEncoder(code_dim=4, channels=[8, 8, 8], image_size=SIDE).eval()


def build(**changes):
    torch.manual_seed(0)
    refiner = PoseRefiner(channels=(8, 8), hidden_dim=16, image_size=SIDE, weights=None)
    return RefinerTraining(refiner, networks, crop=RandomCrop(SIDE), **{"repeats": 1, "memory": 32} | changes)


def batch(rows=4, seed=0):
    rng = torch.Generator().manual_seed(seed)
    views = {"target": torch.rand(rows, 3, 20, 20, generator=rng), "target_mask": torch.zeros(rows, 1, 20, 20)}
    views["target_mask"][..., 4:16, 6:14] = 1
    angles = {name: torch.rand(rows, generator=rng) for name in ("azimuth", "elevation")}
    return {"mug": views | angles | {"distance": torch.full((rows,), 3.0)}}


def rows(count=4, seed=0):
    rng = torch.Generator().manual_seed(seed)
    shapes = {"observed": (4, SIDE, SIDE), "drawn": (4, SIDE, SIDE), "up": (3,), "rotation": (3,), "shift": (2,)}
    made = {name: torch.rand(count, *shape, generator=rng) for name, shape in shapes.items()}
    numbers = {name: torch.rand(count, generator=rng) / 4 for name in ("log_scale", "error")}
    return RefinerRows(**made, **numbers, free_turn=torch.zeros(count))


@pytest.fixture
def logged(monkeypatch):
    entries = {}
    monkeypatch.setattr(RefinerTraining, "log", lambda self, name, value, **more: entries.update({name: float(value)}))
    return entries


def test_a_drawing_at_the_true_pose_is_the_crop_of_a_view(monkeypatch):
    generator, _ = networks("mug")
    field = generator.thickness = 4000.0  # solid
    assert field
    angles = {"azimuth": torch.tensor([0.3, 2.0]), "elevation": torch.tensor([0.5, 0.1])}
    focal = focal_by_distance(torch.tensor([2.0, 4.0]), generator.unit_fraction)
    code = torch.zeros(2, 4)
    with torch.no_grad():
        view = generator(code=code, **angles, focal=focal)
        crop = RolledCrop.around(view.mask, torch.tensor([0.4, -1.0]), torch.tensor([[0.1, 0.0], [0.0, -0.05]]))
        shift = crop.centre * torch.tensor([-2.0, 2.0]) / crop.side[:, None]
        log_scale = (SIDE / crop.side).log()
        rotation = rotation_from_angles(angles["azimuth"], angles["elevation"], crop.roll)
        truth = (rotation, shift, log_scale)
        observed = torch.cat([crop.cut(view.image, SIDE), 1 - crop.cut(1 - view.mask, SIDE)], 1)
        lens, whole_mask = focal * log_scale.exp(), torch.ones(2, 1, SIDE, SIDE)
        drawn = Hypotheses(observed, *truth, *truth, code, lens, whole_mask).draw(generator, "none")
    torch.testing.assert_close(drawn.drawn, observed, rtol=0, atol=1e-4)
    assert drawn.error.abs().max() < 1e-3
    assert drawn.rotation.abs().max() < 1e-3


def test_hypotheses_advance_to_the_truth_by_the_true_update():
    module = build()
    sample = module._observed("mug", batch()["mug"])
    with torch.no_grad():
        made = sample.draw(networks("mug")[0], "none")
    sigma = torch.zeros(4, 4)
    there = sample.advance(PoseUpdate(made.rotation, made.shift, made.log_scale, sigma, sigma[:, 0]))
    torch.testing.assert_close(there.at_rotation, sample.rotation, rtol=0, atol=1e-4)
    torch.testing.assert_close(there.at_shift, sample.shift, rtol=0, atol=1e-5)
    torch.testing.assert_close(there.at_log_scale, sample.log_scale, rtol=0, atol=1e-5)


def test_hypotheses_are_near_flipped_or_of_any_kind():
    torch.manual_seed(0)
    truth = rotation_from_angles(*(6 * torch.rand(3, 4000)))
    found = random_hypotheses(truth)
    torch.testing.assert_close(found @ found.mT, torch.eye(3).expand(4000, 3, 3), rtol=0, atol=1e-4)
    torch.testing.assert_close(torch.linalg.det(found), torch.ones(4000), rtol=0, atol=1e-4)
    off = rotation_error(found, truth).rad2deg()
    assert 0.58 < float((off < 32.1).float().mean()) < 0.67
    assert 0.13 < float((off > 160).float().mean()) < 0.25


def test_a_mirror_shows_the_update_of_the_mirrored_pose():
    here, there = (rotation_from_angles(*torch.rand(3, 2, generator=torch.Generator().manual_seed(s))) for s in (0, 1))
    flip = torch.diag(torch.tensor([-1.0, 1.0, 1.0]))
    sample = rows(2)._replace(rotation=rotation_update(here, there), up=here[:, :, 1])
    result = sample.mirrored(torch.tensor([True, False]))
    expected = rotation_update(flip @ here @ flip, flip @ there @ flip)
    torch.testing.assert_close(result.rotation[0], expected[0])
    torch.testing.assert_close(result.up[0], (flip @ here @ flip)[0, :, 1])
    torch.testing.assert_close(result.observed[0], sample.observed[0].flip(2))
    torch.testing.assert_close(result.shift[0], sample.shift[0] * torch.tensor([-1.0, 1.0]))
    assert all(torch.equal(a[1], b[1]) for a, b in zip(result, sample, strict=True))


def test_losses_are_least_at_the_true_update_and_ignore_free_turns():
    sample = rows()._replace(up=torch.tensor([[0.0, 1.0, 0.0]]).expand(4, 3))
    sigma = torch.full((4, 4), -3.0)
    exact = PoseUpdate(sample.rotation, sample.shift, sample.log_scale, sigma, torch.full((4,), 3.0))
    least = sample.losses(exact)
    for name, value in sample.losses(exact._replace(rotation=exact.rotation + 0.1)).items():
        assert value > least[name] if name in ("tilt", "turn") else value == least[name]
    free = sample._replace(free_turn=torch.ones(4))
    rotated = exact.rotation + torch.tensor([0.0, 0.5, 0.0])
    assert free.losses(exact._replace(rotation=rotated))["turn"] == free.losses(exact)["turn"]
    wrong = sample._replace(error=torch.full((4,), math.pi))
    assert wrong.losses(exact)["right"] > least["right"]
    assert wrong.losses(exact)["tilt"] == 0


def test_a_memory_holds_the_latest_rows():
    memory = RefinerMemory(6)
    memory.add(rows(4))
    latest = rows(4, seed=1)
    memory.add(latest)
    kept = memory.sample(64)
    assert set(kept.error.tolist()) <= set(rows(4).error[2:].tolist()) | set(latest.error.tolist())
    number = kept.error.tolist().index(latest.error[0].item())
    torch.testing.assert_close(kept.observed[number], latest.observed[0], rtol=0, atol=0.003)


def test_the_next_step_continues_from_where_the_refiner_led(logged):
    module = build(repeats=0)
    module.training_step(batch(), 0)
    assert len(module._walking["mug"].focal) == 4
    recorded = []
    module.refiner.register_forward_pre_hook(lambda network, args: recorded.append(len(args[0])))
    module.training_step(batch(seed=1), 1)
    assert recorded == [8]
    assert {"train/tilt", "train/turn", "train/shift", "train/scale", "train/right"} <= set(logged)


def test_validation_shows_the_same_hypotheses_and_leaves_random_numbers_alone(logged):
    module, sample = build().eval(), batch(rows=16)
    state = torch.get_rng_state()
    with torch.no_grad():
        module.validation_step(sample, 0)
    first = dict(logged)
    assert torch.equal(torch.get_rng_state(), state)
    with torch.no_grad():
        module.validation_step(sample, 0)
    assert {name: value for name, value in logged.items() if name in first} == first
    assert first["val/loss"] == pytest.approx(
        sum(first[f"val/{name}"] for name in ("tilt", "turn", "shift", "scale")) + 2 * first["val/right"], rel=1e-5
    )


@pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)
def test_some_steps_lessen_the_loss_and_the_checkpoint_has_the_refiner_alone(tmp_path):
    sample, module = batch(), build(rate=0.01)

    def loss():
        with torch.no_grad():
            made = module.eval()._drawn("mug", module._observed("mug", sample["mug"]))
            value = sum(made.losses(module.refiner(made.observed, made.drawn)).values())
        module.train()
        return float(value)

    torch.manual_seed(3)
    before = loss()
    trainer = Trainer(
        default_root_dir=tmp_path, max_epochs=25, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    one = DataLoader([sample], batch_size=None)
    trainer.fit(module, one, one)
    torch.manual_seed(3)
    assert loss() < before
    trainer.save_checkpoint(tmp_path / "all.ckpt")
    saved = torch.load(tmp_path / "all.ckpt", weights_only=True)
    assert all(name.startswith("refiner.") for name in saved["state_dict"])
