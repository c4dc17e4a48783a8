"""Motions of a volume: variables and matrices."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from kfit.core import SO3, Positive, Variable, Variables

_SHIFT, _ROTATION = {"shift": Variable((3,))}, {"rotation": Variable((3, 3), SO3())}
VOLUME_MOTIONS: dict[str, dict[str, Variable]] = {
    "translation": _SHIFT,
    "euclidean": _ROTATION | _SHIFT,
    "similarity": _ROTATION | _SHIFT | {"scale": Variable((), Positive())},
    "affine": _SHIFT | {"linear": Variable((3, 3))},
}


def volume_matrix_of(values: Mapping[str, Tensor], size: tuple[int, ...]) -> Tensor:
    """Return matrices (N, 4, 4) from the template's voxels (x, y, z) to the drawing's, both of ``size`` (D, H, W)."""
    shift = values["shift"]
    half, middle = _frame(shift, size)
    linear = torch.eye(3).to(shift).expand(len(shift), 3, 3)
    linear = values.get("linear", values.get("rotation", linear))
    if "scale" in values:
        linear = values["scale"][:, None, None] * linear
    offset = middle + shift * half - linear @ middle
    bottom = shift.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(len(shift), 1, 4)
    return torch.cat([torch.cat([linear, offset[..., None]], 2), bottom], 1)


def volume_values_of(motion: str, matrix: Tensor, size: tuple[int, ...]) -> Variables:
    """Return the values of a motion that equals a matrix (N, 4, 4), or approximates it.

    All motions agree with the matrix at the centre; rotation and scale are the least-squares solution.
    """
    half, middle = _frame(matrix, size)
    linear = matrix[:, :3, :3]
    found = {"shift": (linear @ middle + matrix[:, :3, 3] - middle) / half}
    if motion == "affine":
        return found | {"linear": linear}
    if motion == "translation":
        return found
    left, stretch, right = torch.linalg.svd(linear)
    # The last axis is reversed if the product is a reflection (Kabsch, 1976).
    sign = torch.ones_like(stretch)
    sign[:, 2] = torch.linalg.det(left @ right).sign()
    found["rotation"] = left * sign[:, None] @ right
    if motion == "similarity":
        found["scale"] = (stretch * sign).mean(1).clamp_min(1e-3)
    return found


def _frame(like: Tensor, size: tuple[int, ...]) -> tuple[Tensor, Tensor]:
    """Return half of the sides of the volume, and its centre, as (x, y, z)."""
    sides = like.new_tensor(size[::-1])
    return sides / 2, (sides - 1) / 2
