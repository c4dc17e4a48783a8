"""Packing: a model's file gets another pose head."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

import kfit
from kfit.generators import RotationHead
from kfit.models import read_checkpoint, write_model
from kfit.models.pack import pack
from kfit.pose import CategoryModel
from kfit.pose.confidence import Calibration


def with_head(model: CategoryModel, path: Path, category: str | None = None) -> Path:
    """A file of the model with a small head."""
    settings = {"channels": [8, 8, 8, 8], "hidden_dim": 8, "bin_deg": 60.0}
    torch.manual_seed(1)
    networks = {name: getattr(model, name) for name in ("generator", "encoder", "extents")}
    named = {**model.card.networks} | {
        "pose_head": {"class_path": "kfit.generators.RotationHead", "init_args": settings}
    }
    card = replace(model.card, networks=named, category=category or model.card.category)
    write_model(path, networks | {"pose_head": RotationHead(**settings)}, card)
    return path


def test_a_model_gets_another_head_and_loses_what_was_measured(
    tiny_model: CategoryModel, tiny_file: Path, tmp_path: Path
) -> None:
    fits = {"starts": 1, "steps": 1, "left": 1, "weights": {"prior": 1.0}}
    calibration = {"RGB": Calibration(0.0, {"weight": 1.0}, 1.0, fits, 10)}
    tiny_model.card = replace(tiny_model.card, accuracy={"views": {"median": 3.0}}, calibration=calibration)
    headed = with_head(tiny_model, tmp_path / "headed.safetensors")
    assert kfit.load(headed).card.accuracy
    pack(headed, tmp_path / "new.safetensors", headed)
    found = kfit.load(tmp_path / "new.safetensors")
    assert isinstance(found.pose_head, RotationHead)
    assert (found.card.accuracy, found.card.calibration) == ({}, {})
    for one, other in zip(found.generator.parameters(), kfit.load(tiny_file).generator.parameters(), strict=True):
        assert torch.equal(one, other)


def test_a_head_of_another_category_is_an_error(tiny_model: CategoryModel, tiny_file: Path, tmp_path: Path) -> None:
    headed = with_head(tiny_model, tmp_path / "bowl.safetensors", "bowl")
    with pytest.raises(ValueError, match="--pose-head is of category bowl, the checkpoint of mug"):
        pack(tiny_file, tmp_path / "new.safetensors", headed)
    assert not (tmp_path / "new.safetensors").exists()


@pytest.mark.parametrize(
    ("held", "wanted", "sentence"),
    [
        (
            ("extents", "generator"),
            ("pose_head",),
            "must hold the pose_head, but holds the extents, generator of another",
        ),
        (("pose_head",), ("generator",), "must hold the generator, but holds the pose_head of another training"),
    ],
)
def test_the_checkpoint_of_another_training_is_called_that(
    tmp_path: Path, held: tuple[str, ...], wanted: tuple[str, ...], sentence: str
) -> None:
    saved = {
        "hyper_parameters": {name: {"class_path": "kfit.generators.ExtentsHead"} for name in held},
        "datamodule_hyper_parameters": {"category": "mug"},
        "state_dict": {f"{name}.weight": torch.zeros(1) for name in held},
    }
    torch.save(saved, tmp_path / "x.ckpt")
    with pytest.raises(ValueError, match=f"x.ckpt {sentence}"):
        read_checkpoint(tmp_path / "x.ckpt", wanted)
