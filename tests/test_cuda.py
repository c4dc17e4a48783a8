"""What runs on a GPU, where there is one."""

from __future__ import annotations

import warnings

import pytest
import torch

import kfit
from kfit.bench.held_out_views import held_out_views
from kfit.core import Observation
from kfit.data import view_pairs
from kfit.geometry import rotation_error
from kfit.geometry.pose import rotation_of
from kfit.runtime.devices import precision

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")


@pytest.mark.parametrize(("how", "within_deg"), [("32", 1.0), ("bf16", 3.0)])
def test_a_gpu_finds_the_poses_that_a_cpu_finds(how, within_deg):
    model = kfit.load("laptop")
    observed = held_out_views(model, 6).observation
    observed = Observation(observed.image, observed.mask, keys=tuple(range(6)))
    here = model.pipeline()(observed, seed=0)
    model.to("cuda")
    with precision(how, "cuda"):
        there = model.pipeline()(observed.map(lambda tensor: tensor.to("cuda")), seed=0).to("cpu")
    assert here.num_evaluations == there.num_evaluations
    away = rotation_error(rotation_of(here.values), rotation_of(there.values)).rad2deg()
    assert float(away.median()) < within_deg


def test_a_photo_is_answered_on_a_gpu_as_on_a_cpu():
    model = kfit.load("laptop")
    views = held_out_views(model, 1)
    here = model.pose(views.photos[0], mask=views.masks[0])
    there = model.to("cuda").pose(views.photos[0], mask=views.masks[0])
    assert abs(here.rotation - there.rotation).max() < 0.05
    assert there.to_dict()["confidence"] == pytest.approx(here.confidence, abs=0.05)


@pytest.mark.parametrize("recipe", ["radiance_field", "pose_head", "vae3d"])
def test_a_recipe_trains_with_its_views_on_the_gpu(recipe, tmp_path, monkeypatch):
    from kfit.training import lightning_cli as lightning

    where = set()
    original = view_pairs.ViewPairs.__getitems__

    def watched(self, indices):
        batch = original(self, indices)
        where.add((len(self) > 100, batch["target"].device.type))
        return batch

    monkeypatch.setattr(view_pairs.ViewPairs, "__getitems__", watched)
    words = ["fit", "-c", f"recipes/{recipe}.yaml", "--data.category", "mug", "--data.num_objects", "120"]
    words += ["--data.num_val_objects", "2", "--data.cache_dir", str(tmp_path), "--trainer.max_epochs", "1"]
    words += ["--trainer.limit_train_batches", "8", "--trainer.default_root_dir", str(tmp_path)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        lightning.run(words)
    assert where == {(True, "cuda"), (False, "cpu")}
