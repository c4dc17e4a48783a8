"""Pairs of views: of one object, once an epoch, and the same for the same seed."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from lightning import LightningModule, Trainer
from lightning.pytorch.trainer.states import TrainerFn

from kfit.data.datamodule import ViewsDataModule
from kfit.data.rendered_views import build_views
from kfit.data.view_pairs import ViewPairs
from kfit.data.views import Views
from kfit.geometry import CATEGORIES

SMALL = {"num_objects": 6, "num_views": 3, "image_size": 16, "batch_size": 4, "num_val_objects": 2}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    ViewsDataModule("can", cache_dir=str(folder), **SMALL).prepare_data()
    return str(folder)


@pytest.fixture
def module(cache):
    module = ViewsDataModule("can", cache_dir=cache, **SMALL)
    module.prepare_data()
    module.setup("fit")
    return module


def test_batches_have_the_stated_names_shapes_and_ranges(module):
    batch = next(iter(module.train_dataloader()))
    shapes = {name: tuple(value.shape) for name, value in batch.items()}
    assert shapes == {
        "source": (4, 3, 16, 16),
        "source_mask": (4, 1, 16, 16),
        "source_elevation": (4,),
        "source_azimuth": (4,),
        "source_distance": (4,),
        "target": (4, 3, 16, 16),
        "target_mask": (4, 1, 16, 16),
        "target_depth": (4, 1, 16, 16),
        "elevation": (4,),
        "azimuth": (4,),
        "distance": (4,),
        "extents": (4, 3),
    }
    assert all(value.dtype == torch.float32 for value in batch.values())
    assert batch["target"].min() >= 0
    assert batch["target"].max() == 1
    assert batch["azimuth"].max() <= 2 * np.pi
    assert batch["elevation"].abs().max() <= np.pi / 2
    assert 1.3 <= batch["distance"].min() <= batch["distance"].max() <= 8


def test_an_epoch_has_every_view_once_as_target_with_another_of_its_object(module):
    pairs = module.train_pairs
    targets = torch.arange(len(pairs))
    sources = pairs.sources(targets)
    assert (sources != targets).all()
    assert torch.equal(sources // 3, targets // 3)
    observed = torch.cat([batch["azimuth"] for batch in module.train_dataloader()])
    # 18 views in batches of 4 leave two out of an epoch.
    assert len(observed) == 16
    assert len(observed.unique()) == 16


def test_extents_and_pictures_belong_to_one_object(module):
    batch = module.train_pairs.__getitems__([4, 17])
    views = Views(module._build("train"))
    np.testing.assert_allclose(batch["extents"].numpy(), views.extents[[1, 5]])
    np.testing.assert_allclose(batch["target"][1].numpy() * 255, views.images[17].transpose(2, 0, 1), atol=1e-3)
    np.testing.assert_allclose(batch["distance"].numpy(), views.distances[[4, 17]])
    sources = module.train_pairs.sources(torch.tensor([4, 17]))
    np.testing.assert_allclose(batch["source_distance"].numpy(), views.distances[sources])
    one = module.train_pairs[4]
    torch.testing.assert_close(one["target"], batch["target"][0])


def test_sources_change_with_the_epoch_and_repeat_with_the_seed(cache):
    views = Views(next(iter(Path(cache).glob("*train*"))))
    epoch = 0
    pairs, twin = (ViewPairs(views, range(6), 5, lambda: epoch) for _ in range(2))
    targets = torch.arange(18)
    first = pairs.sources(targets)
    assert torch.equal(first, twin.sources(targets))
    epoch = 1
    assert not torch.equal(first, pairs.sources(targets))
    epoch = 0
    assert torch.equal(first, pairs.sources(targets))


def test_the_order_of_training_repeats_with_the_seed_and_validation_is_fixed(cache):
    def orders(seed):
        module = ViewsDataModule("can", cache_dir=cache, seed=0, **SMALL)
        module.setup()
        module.seed = seed
        return (
            torch.cat([b["azimuth"] for b in loader]) for loader in (module.train_dataloader(), module.val_dataloader())
        )

    (train, val), (again, val_again), (other, _) = orders(0), orders(0), orders(1)
    assert torch.equal(train, again)
    assert torch.equal(val, val_again)
    assert not torch.equal(train, other)


def test_validation_shows_held_out_families(module):
    assert len(module.val_pairs) == 6
    path = module._build("val")
    fraction = CATEGORIES["can"].unit_fraction
    again = build_views(path.with_name("again.h5"), "can", 2, 3, 16, held_out=True, unit_fraction=fraction)
    np.testing.assert_array_equal(Views(path).images, Views(again).images)


def test_test_shows_others_of_the_held_out_families(cache):
    module = ViewsDataModule("can", cache_dir=cache, **SMALL)
    module.setup("test")
    assert (module.train_pairs, module.val_pairs) == (None, None)
    fraction = CATEGORIES["can"].unit_fraction
    settings = {"seed": 1_000_000, "held_out": True, "unit_fraction": fraction}
    again = Views(build_views(Path(cache) / "again.h5", "can", 2, 3, 16, **settings))
    observed = next(iter(module.test_dataloader()))
    np.testing.assert_array_equal((observed["target"] * 255).byte().permute(0, 2, 3, 1), again.images[:4])
    module.setup("validate")
    assert not torch.equal(module.val_pairs.images, module.test_pairs.images)


def test_the_range_of_distances_is_passed_on_and_replaces_no_views_of_others(tmp_path, caplog):
    others = ViewsDataModule("can", cache_dir=str(tmp_path), **SMALL)
    module = ViewsDataModule("can", cache_dir=str(tmp_path), distance_range=(4.0, 4.0), **SMALL)
    for _ in range(2):
        assert (Views(module._build("val")).distances == 4).all()
        assert (Views(others._build("val")).distances != 4).all()
    assert "built anew" not in caplog.text


@pytest.mark.parametrize(("does", "rendered"), [("fit", "train val"), ("validate", "val"), ("test", "test")])
def test_only_what_a_trainer_needs_is_rendered(tmp_path, does, rendered):
    module = ViewsDataModule("can", cache_dir=str(tmp_path), **SMALL)
    module.trainer = SimpleNamespace(state=SimpleNamespace(fn=TrainerFn(does)))
    module.prepare_data()
    assert " ".join(sorted(path.name.split("_")[1] for path in tmp_path.iterdir())) == rendered


def test_an_existing_file_tests_on_other_pairs_of_the_objects_that_it_validates_on(tmp_path):
    path = build_views(tmp_path / "bowls.h5", "bowl", 4, 8, image_size=16)
    module = ViewsDataModule(views=str(path), num_views=8, num_val_objects=1)
    for stage in ("validate", "test"):
        module.setup(stage)
    assert torch.equal(module.val_pairs.images, module.test_pairs.images)
    targets = torch.arange(8)
    assert not torch.equal(module.val_pairs.sources(targets), module.test_pairs.sources(targets))


def test_an_existing_file_is_split_by_objects(tmp_path):
    path = build_views(tmp_path / "bowls.h5", "bowl", 4, 2, image_size=16)
    module = ViewsDataModule(views=str(path), num_views=2, num_val_objects=1)
    module.prepare_data()
    module.setup()
    assert (len(module.train_pairs), len(module.val_pairs)) == (6, 2)


def test_a_folder_of_meshes_replaces_the_procedural_objects(tmp_path):
    import trimesh

    for k in range(3):
        trimesh.creation.box((1, 1 + k, 1)).export(tmp_path / f"{k}.ply")
    module = ViewsDataModule(meshes=str(tmp_path), cache_dir=str(tmp_path / "cache"), **{**SMALL, "num_objects": 2})
    module.prepare_data()
    module.setup()
    tall = np.array([1, 2, 1]) / np.sqrt(6)
    np.testing.assert_allclose(module.train_pairs.extents[0], tall, atol=1e-5)
    np.testing.assert_allclose(module.val_pairs.extents[0], np.sqrt(1 / 3), atol=1e-5)


@pytest.mark.filterwarnings("ignore:.*LeafSpec.*:FutureWarning")
def test_a_trainer_runs_over_it(cache):
    class Mean(LightningModule):
        def __init__(self):
            super().__init__()
            self.level = torch.nn.Parameter(torch.zeros(()))

        def training_step(self, batch, index):
            return (batch["target"] - self.level).square().mean()

        def validation_step(self, batch, index):
            assert batch["source"].shape == batch["target"].shape

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), 0.1)

    module = ViewsDataModule("can", cache_dir=cache, **{**SMALL, "batch_size": 6})
    trainer = Trainer(
        max_epochs=2,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        log_every_n_steps=1,
    )
    trainer.fit(Mean(), module)
    assert trainer.global_step == 6
    assert module.train_pairs._drawn_for == 1


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match=r"category must be one of .* got 'cup'"):
        ViewsDataModule("cup")
    with pytest.raises(ValueError, match="num_views must be at least 2"):
        ViewsDataModule(num_views=1)
    with pytest.raises(ValueError, match="must not both be given"):
        ViewsDataModule(meshes="a", views="b")
    with pytest.raises(ValueError, match="setup must be called"):
        ViewsDataModule().train_dataloader()
