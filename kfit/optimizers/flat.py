"""Variables concatenated to vectors, for optimizers that work on all numbers of a row at once."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core import Variables


def flatten(variables: Variables) -> Tensor:
    """Concatenate all numbers of each row to (N, P), in the variables' order."""
    return torch.cat([tensor.flatten(1) if tensor.dim() > 1 else tensor[:, None] for tensor in variables.values()], 1)


def unflatten(flat: Tensor, like: Variables) -> Variables:
    """Invert `flatten`: split (N, P) into the names and shapes of ``like``, whatever its number of rows."""
    parts = flat.split([math.prod(tensor.shape[1:]) for tensor in like.values()], 1)
    return {name: part.reshape(-1, *tensor.shape[1:]) for part, (name, tensor) in zip(parts, like.items(), strict=True)}


def repeated(variables: Variables, count: int) -> Variables:
    """Repeat each row ``count`` times in succession: (N · count, \\*shape)."""
    return {name: tensor.repeat_interleave(count, 0) for name, tensor in variables.items()}
