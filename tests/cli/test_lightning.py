"""What `lightning` adds to Lightning's command line."""

from pathlib import Path

import pytest
import torch
from lightning.pytorch import LightningDataModule, LightningModule

from kfit.cli.lightning import _CLI
from kfit.geometry import CATEGORIES

RECIPES = Path(__file__).parents[2] / "recipes"


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
    # The ray through the picture's corner passes the centre at half of the picture's width.
    corner, half = model.generator.rays[0, 0, 0], 63 / 64 / 2 / known.unit_fraction
    torch.testing.assert_close(corner, torch.tensor([-half, half, 0.0]), rtol=0, atol=1e-5)
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
    assert model.generator.rays[0, 0, 0, 0] == pytest.approx(-63 / 64 / 2 / CATEGORIES["mug"].unit_fraction)


def test_a_generator_without_a_camera_is_left_as_it_is():
    model = model_of("-c", RECIPES / "smoke.yaml", "--data.category", "bowl")
    assert "unit_fraction" not in model.hparams["generator"]["init_args"]
