"""A model that is small enough to build and fit in a test."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from kfit import generators
from kfit.geometry import CATEGORIES
from kfit.models import write_model
from kfit.pose import Card, CategoryModel

Networks = Mapping[str, Mapping[str, Any]]

TINY: Networks = {
    "generator": {
        "class_path": "kfit.generators.VAE3D",
        "init_args": {"code_dim": 4, "volume_dims": [8, 8, 4], "projection_dim": 8, "decoder_dims": [8, 8]},
    },
    "encoder": {"class_path": "kfit.generators.ConvEncoder", "init_args": {"code_dim": 4, "channels": [8, 8, 8, 8]}},
    "extents": {"class_path": "kfit.generators.ExtentsHead", "init_args": {"code_dim": 4}},
}
# One that draws depth.
TINY_FIELD: Networks = {
    **TINY,
    "generator": {
        "class_path": "kfit.generators.RadianceField",
        "init_args": {"code_dim": 4, "volume_dims": [8, 4], "num_samples": 4},
    },
}


def tiny_card(category: str = "mug", networks: Networks = TINY) -> Card:
    known = Card.fields_of(CATEGORIES[category])
    return Card(category, {name: dict(one) for name, one in networks.items()}, 4.0, **known | {"unit_fraction": 1.0})


def tiny_networks(networks: Networks = TINY) -> dict[str, nn.Module]:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return {
            name: getattr(generators, one["class_path"].rpartition(".")[2])(**one["init_args"])
            for name, one in networks.items()
        }


def write_tiny(path: Path, category: str = "mug", networks: Networks = TINY) -> Path:
    """Write a file of a small untrained model."""
    write_model(path, tiny_networks(networks), tiny_card(category, networks))
    return path


@pytest.fixture
def tiny_model() -> CategoryModel:
    return CategoryModel(**tiny_networks(), card=tiny_card())


@pytest.fixture
def tiny_file(tmp_path: Path) -> Path:
    return write_tiny(tmp_path / "tiny.safetensors")
