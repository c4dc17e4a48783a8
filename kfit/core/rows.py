"""Rows in order, and rows that are whole: what selecting, starting and pruning share."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core.variables import Variables


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


def broadcast_rows(rows: Tensor, like: Tensor) -> Tensor:
    """Rows' numbers (N,) in the shape (N, 1, …), as they meet a tensor (N, \\*shape)."""
    return rows.view(-1, *[1] * (like.dim() - 1))


def finite(variables: Variables) -> Tensor:
    """Which rows (N,) hold finite numbers alone, of variables (N, \\*shape)."""
    return torch.stack(
        [
            tensor.isfinite().flatten(1).all(1) if tensor.dim() > 1 else tensor.isfinite()
            for tensor in variables.values()
        ]
    ).all(0)


def pictures_of(rows: Tensor, views: int) -> Tensor:
    """Numbers (N · views,) of the pictures that belong to rows or problems (N,) of so many pictures each."""
    if views == 1:
        return rows
    return (rows[:, None] * views + torch.arange(views, device=rows.device)).flatten()
