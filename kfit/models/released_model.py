"""A released checkpoint as a model, with the head and the card that the released code lacks."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from kfit.data.rasterizer import DISTANCE
from kfit.data.shapes import build
from kfit.generators import ExtentsHead
from kfit.geometry import CATEGORIES
from kfit.models.released import load_released, released_sizes
from kfit.pose.card import Card

# Number of procedural objects whose mean sides are used for every object.
OBJECTS = 64


def released_model(path: str | Path, category: str) -> tuple[dict[str, nn.Module], Card]:
    """Read a released ``model_latest.pth`` as networks and card, which `kfit.models.write_model` takes.

    Poses are NOCS's, see `kfit.models.load_released`. The checkpoint holds neither sizes nor the training camera.
    Extents are therefore the mean of procedural objects of the category, for every code, and the card assumes that a
    unit diagonal spans the width of the training pictures, which determines translation and size. It draws neither mask
    nor depth, so a fit compares pictures alone.

    Args:
        path: path of the checkpoint.
        category: category of its training data, which the file does not name.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not such a checkpoint, or the category is unknown.
    """
    if category not in CATEGORIES:
        raise ValueError(f"category must be one of {', '.join(CATEGORIES)}, got {category!r}")
    known = CATEGORIES[category]
    generator, encoder = load_released(path)
    sizes = released_sizes(generator.code_dim) | {"extents": {"code_dim": generator.code_dim}}
    classes = {"generator": "VAE3D", "encoder": "ConvEncoder", "extents": "ExtentsHead"}
    card = Card(
        category=category,
        networks={
            name: {"class_path": f"kfit.generators.{kind}", "init_args": sizes[name]} for name, kind in classes.items()
        },
        distance=DISTANCE,
        **Card.fields_of(known) | {"unit_fraction": 1.0},
        training={
            "source": "a released checkpoint of xuchen-ethz/neural_object_fitting@7309348",
            "assumed": f"extents: mean of {OBJECTS} procedural objects; unit_fraction and distance: not in the file",
        },
    )
    extents = _constant_extents(generator.code_dim, _mean_extents(category))
    return {"generator": generator, "encoder": encoder, "extents": extents}, card


def _mean_extents(category: str) -> Tensor:
    sides = [torch.from_numpy(build(category, seed)[0].extents) for seed in range(OBJECTS)]
    return torch.stack(sides).double().mean(0)


def _constant_extents(code_dim: int, sides: Tensor) -> ExtentsHead:
    """Return a head with these sides (3,), scaled to a diagonal of 1, for every code."""
    head = ExtentsHead(code_dim)
    numbers = {name: torch.zeros_like(tensor) for name, tensor in head.state_dict().items()}
    numbers["layers.2.bias"] = (sides / sides.norm() - 1e-3).expm1().log()  # inverts the layer's output function
    head.load_state_dict(numbers)
    return head.eval()
