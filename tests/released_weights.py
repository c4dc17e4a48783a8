"""Weights of the released networks' names and shapes, made by a rule."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from torch import Tensor

SHAPES = Path(__file__).parent / "models/released_reference/shapes.json"


def released_weights() -> dict[str, dict[str, Tensor]]:
    """State dicts of a ``model_latest.pth``, of which the values in ``released_reference`` were computed."""
    return {network: _rule(shapes) for network, shapes in json.loads(SHAPES.read_text()).items()}


def _rule(shapes: dict[str, list[int]]) -> dict[str, Tensor]:
    made = {}
    for index, name in enumerate(sorted(shapes)):
        tensor = torch.randn(shapes[name], generator=torch.Generator().manual_seed(index))
        if name.endswith(("_u", "_v")):
            tensor = tensor / tensor.norm()
        elif name == "shape_code":
            tensor = tensor * 0.5
        else:
            tensor = tensor * (0.05 if tensor.dim() > 1 else 0.02)
        made[name] = tensor
    return made
