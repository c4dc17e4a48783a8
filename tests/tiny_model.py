"""A model that is small enough to build and fit in a test."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from kfit.generators import VAE3D, ConvEncoder, ExtentsHead
from kfit.geometry import CATEGORIES
from kfit.models import write_model
from kfit.pose import Card, CategoryModel

TINY = {
    "generator": {
        "class_path": "kfit.generators.VAE3D",
        "init_args": {"code_dim": 4, "volume_dims": [8, 8, 4], "projection_dim": 8, "decoder_dims": [8, 8]},
    },
    "encoder": {"class_path": "kfit.generators.ConvEncoder", "init_args": {"code_dim": 4, "channels": [8, 8, 8, 8]}},
    "extents": {"class_path": "kfit.generators.ExtentsHead", "init_args": {"code_dim": 4}},
}


def tiny_card(category: str = "mug") -> Card:
    known = Card.fields_of(CATEGORIES[category])
    return Card(category, TINY, 4.0, **known | {"unit_fraction": 1.0})


@pytest.fixture
def tiny_model() -> CategoryModel:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        networks = {
            "generator": VAE3D(**TINY["generator"]["init_args"]),
            "encoder": ConvEncoder(**TINY["encoder"]["init_args"]),
            "extents": ExtentsHead(**TINY["extents"]["init_args"]),
        }
    return CategoryModel(**networks, card=tiny_card())


@pytest.fixture
def tiny_file(tiny_model: CategoryModel, tmp_path: Path) -> Path:
    path = tmp_path / "tiny.safetensors"
    parts = {"generator": tiny_model.generator, "encoder": tiny_model.encoder, "extents": tiny_model.extents}
    write_model(path, parts, tiny_model.card)
    return path
