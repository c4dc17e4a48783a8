"""Symmetries of objects: none, all rotations about the vertical axis, or k of them."""

from __future__ import annotations

import math
from typing import TypeAlias

import torch
from torch import Tensor

from kfit.core.check import check_choice

Symmetry: TypeAlias = str
MOST_TURNS = 12
SYMMETRIES = ("none", "y", *(f"y{fold}" for fold in range(2, MOST_TURNS + 1)))
"""``"none"``; ``"y"``, any turn about the vertical axis; ``"y2"`` to ``"y12"``, turns by 360° / k about it."""


def check_symmetry(name: str, value: object) -> None:
    """Check that an argument is one of ``SYMMETRIES``.

    Raises:
        TypeError, ValueError: If it is not; the message names the argument.

    Example:
        >>> from kfit.geometry import check_symmetry
        >>> check_symmetry("symmetry", "y4")
    """
    check_choice(name, value, SYMMETRIES)


def num_turns(symmetry: Symmetry) -> int:
    """Return the number of rotations about the vertical axis that leave the object unchanged; 0 means all.

    Example:
        >>> from kfit.geometry import num_turns
        >>> [num_turns(symmetry) for symmetry in ("none", "y4", "y")]
        [1, 4, 0]
    """
    return {"none": 1, "y": 0}[symmetry] if symmetry in ("none", "y") else int(symmetry[1:])


def turns_about_y(count: int) -> Tensor:
    """Return the rotations (K, 3, 3) about the vertical axis by 360° · k / K, k = 0 … K − 1.

    Example:
        >>> from kfit.geometry import turns_about_y
        >>> turns_about_y(2)[1].round().int()
        tensor([[-1,  0,  0],
                [ 0,  1,  0],
                [ 0,  0, -1]], dtype=torch.int32)
    """
    angle = 2 * math.pi / count * torch.arange(count, dtype=torch.float64)
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
    turns: Tensor = torch.stack([cos, zero, sin, zero, one, zero, -sin, zero, cos], 1).unflatten(1, (3, 3))
    return turns
