"""Rows in order: what selecting and pruning share."""

from __future__ import annotations

import torch
from torch import Tensor


def best_first(energy: Tensor, problem: Tensor) -> tuple[Tensor, Tensor]:
    """Rows (N,) by problem and within it by energy, of equals the earlier first, and their places (N,) in it, from 0.

    Args:
        energy: (N,).
        problem: (N,) numbers 0 … B−1, in any order.
    """
    by_energy = energy.argsort(stable=True)
    order = by_energy[problem[by_energy].argsort(stable=True)]
    counts = torch.bincount(problem)
    first = (counts.cumsum(0) - counts)[problem[order]]
    return order, torch.arange(len(order), device=order.device) - first
