"""Sorting, broadcasting and selecting rows."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core.variables import Variables


def best_first(energy: Tensor, problem: Tensor) -> tuple[Tensor, Tensor]:
    """Sort rows by problem, and within a problem by energy; the earlier of equals first.

    Args:
        energy: (N,).
        problem: (N,) numbers 0 … B−1, in any order.

    Returns:
        The sorted rows (N,), and the place (N,) of each in its problem, from 0.
    """
    by_energy = energy.argsort(stable=True)
    order = by_energy[problem[by_energy].argsort(stable=True)]
    counts = torch.bincount(problem)
    first = (counts.cumsum(0) - counts)[problem[order]]
    return order, torch.arange(len(order), device=order.device) - first


def broadcast_rows(rows: Tensor, like: Tensor) -> Tensor:
    """Reshape one number a row, (N,), to (N, 1, …), to broadcast with a tensor (N, \\*shape)."""
    return rows.view(-1, *[1] * (like.dim() - 1))


def finite(variables: Variables) -> Tensor:
    """Return which rows (N,) of variables (N, \\*shape) are finite."""
    return torch.stack(
        [
            tensor.isfinite().flatten(1).all(1) if tensor.dim() > 1 else tensor.isfinite()
            for tensor in variables.values()
        ]
    ).all(0)


def pictures_of(rows: Tensor, views: int) -> Tensor:
    """Return the numbers (N · views,) of the pictures of rows or problems (N,)."""
    if views == 1:
        return rows
    return (rows[:, None] * views + torch.arange(views, device=rows.device)).flatten()
