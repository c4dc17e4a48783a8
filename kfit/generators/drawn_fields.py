"""Which fields a generator draws."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import Generator, Rendering


def drawn_fields(generator: Generator, like: Tensor) -> frozenset[str]:
    """Names of the fields of its renderings, of ``image``, ``mask``, ``depth`` and ``weight``.

    Args:
        generator: draws one row, of zeros.
        like: tensor whose dtype and device are used.
    """
    zeros = {name: like.new_zeros(1, *variable.shape) for name, variable in generator.variables.items()}
    with torch.no_grad():
        rendering: Rendering = generator(**zeros)
    return frozenset(name for name, field in vars(rendering).items() if field is not None)
