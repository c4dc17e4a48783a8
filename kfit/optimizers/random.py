"""Random numbers that each row draws from its own seed."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def normal(seeds: Tensor, shape: Sequence[int], like: Tensor) -> Tensor:
    """Draw standard normal numbers (N, \\*shape), each row's determined by its seed alone.

    Args:
        seeds: (N,) whole numbers.
        shape: shape of one row.
        like: gives type and device; the numbers are drawn on the CPU, so they are the same on every device.
    """
    rng = torch.Generator()
    rows = [torch.randn(tuple(shape), generator=rng.manual_seed(seed), dtype=torch.float64) for seed in seeds.tolist()]
    return torch.stack(rows).to(like)
