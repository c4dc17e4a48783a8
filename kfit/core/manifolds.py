"""Curved spaces: rotations, unit vectors, and positive numbers that sum to 1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from kfit.core.variables import Space


@dataclass(frozen=True)
class SO3(Space):
    """Rotation matrices (3, 3): raw numbers are rotation vectors (3,) in half-turns, value = exp(π · [raw]×).

    A step δ turns about the object's own axes, R ← R · exp(π · [δ]×): retraction by the group's exponential map,
    alike at every rotation. Raw numbers stay within a half-turn: |raw| ≤ 1. (Solà et al., "A micro Lie theory for
    state estimation in robotics", 2018, equations 25, 132 to 146.)

    Example:
        >>> import torch
        >>> space = SO3()
        >>> quarter = space.to_value(torch.tensor([0.0, 0.0, 0.5]))  # about z
        >>> quarter.round(decimals=3).tolist()
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        >>> space.to_raw(quarter).round(decimals=3).tolist()
        [0.0, 0.0, 0.5]
    """

    radians: ClassVar[float] = math.pi

    def to_value(self, raw: Tensor) -> Tensor:
        w, x, y, z = _quaternion(raw).unbind(-1)
        rows = (
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        )  # fmt: skip
        matrix: Tensor = torch.stack(rows, -1).unflatten(-1, (3, 3))
        return matrix

    def to_raw(self, value: Tensor) -> Tensor:
        unit = value.mT @ value - torch.eye(3, dtype=value.dtype, device=value.device)
        off = torch.maximum(unit.abs().amax((-2, -1)), (torch.linalg.det(value) - 1).abs())
        if bool((off > 1e-3).any()):  # NaN stays NaN in its own row
            raise ValueError(
                f"an SO3 variable must hold rotation matrices, got one that is off by {float(off.nan_to_num().max()):g}"
            )
        return _rotation_vector(_quaternion_of(value))

    def retract(self, raw: Tensor, step: Tensor) -> Tensor:
        return _rotation_vector(_product(_quaternion(raw), _quaternion(step)))

    def raw_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        if tuple(shape) != (3, 3):
            raise ValueError(f"a variable in SO3 must have shape (3, 3), got {tuple(shape)}")
        return (3,)


@dataclass(frozen=True)
class UnitVector(Space):
    """Directions: vectors of length 1, value = raw / |raw|.

    A step δ is projected to the tangent plane, t = δ − (δ·u)u, and followed along the great circle,
    u ← cos|t| · u + sin|t| · t/|t|; so its length is an angle in radians. (Absil, Mahony and Sepulchre, "Optimization
    algorithms on matrix manifolds", 2008, example 5.4.1.)

    Example:
        >>> import torch
        >>> UnitVector().to_value(torch.tensor([3.0, 0.0, 4.0])).tolist()
        [0.6000000238418579, 0.0, 0.800000011920929]
    """

    def to_value(self, raw: Tensor) -> Tensor:
        unit: Tensor = raw / raw.norm(dim=-1, keepdim=True)
        return unit

    def to_raw(self, value: Tensor) -> Tensor:
        if bool((value.norm(dim=-1) == 0).any()):
            raise ValueError("a UnitVector variable must not be the zero vector")
        return self.to_value(value)

    def retract(self, raw: Tensor, step: Tensor) -> Tensor:
        here = self.to_value(raw)
        tangent = step - (step * here).sum(-1, keepdim=True) * here
        cos, sinc = _cos_and_sinc(tangent.square().sum(-1, keepdim=True))
        return cos * here + sinc * tangent

    def raw_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        if not shape or shape[-1] < 2:
            raise ValueError(
                f"a variable in UnitVector must hold vectors of at least 2 numbers, got shape {tuple(shape)}"
            )
        return shape


@dataclass(frozen=True)
class Simplex(Space):
    """Positive numbers that sum to 1 along the last axis, value = softmax(raw).

    Numbers below 1e-6, where the slope vanishes, start at 1e-6.

    Example:
        >>> import torch
        >>> Simplex().to_value(torch.tensor([0.0, 0.0])).tolist()
        [0.5, 0.5]
    """

    def to_value(self, raw: Tensor) -> Tensor:
        return raw.softmax(-1)

    def to_raw(self, value: Tensor) -> Tensor:
        off = (value.sum(-1) - 1).abs()
        if bool((value < 0).any()) or bool((off > 1e-3).any()):
            raise ValueError("a Simplex variable must hold numbers of at least 0 that sum to 1")
        logs = value.clamp_min(1e-6).log()
        return logs - logs.mean(-1, keepdim=True)

    def raw_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        if not shape or shape[-1] < 2:
            raise ValueError(f"a variable in Simplex must hold at least 2 numbers, got shape {tuple(shape)}")
        return shape


def _cos_and_sinc(square: Tensor) -> tuple[Tensor, Tensor]:
    """Compute cos √s and sin √s / √s, with all derivatives also at s = 0."""
    small = square < 1e-4
    root = square.where(~small, 1.0).sqrt()
    # The next Taylor terms are below 1e-17.
    cos = 1 - square / 2 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56)))
    sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    return torch.where(small, cos, root.cos()), torch.where(small, sinc, root.sin() / root)


def _quaternion(raw: Tensor) -> Tensor:
    """Return unit quaternions (…, 4), scalar first, of rotation vectors (…, 3) in half-turns."""
    half = raw * (math.pi / 2)
    cos, sinc = _cos_and_sinc(half.square().sum(-1, keepdim=True))
    return torch.cat([cos, sinc * half], -1)


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Multiply quaternions (…, 4), by Hamilton."""
    (s, u), (t, v) = ((q[..., :1], q[..., 1:]) for q in (a, b))
    cross = torch.linalg.cross(*torch.broadcast_tensors(u, v))
    return torch.cat([s * t - (u * v).sum(-1, keepdim=True), s * v + t * u + cross], -1)


def _rotation_vector(quaternion: Tensor) -> Tensor:
    """Return the shortest rotation vectors (…, 3), in half-turns, of unit quaternions (…, 4)."""
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    square = vector.square().sum(-1, keepdim=True)
    small = square < 1e-8
    length = square.where(~small, 1.0).sqrt()
    share = square / scalar.where(small, 1.0).square()
    series = (1 - share / 3 * (1 - share * 3 / 5)) / scalar.where(small, 1.0)  # atan(t) / t, t = |v| / w
    return vector * (2 / math.pi) * torch.where(small, series, torch.atan2(length, scalar) / length)


def _quaternion_of(matrix: Tensor) -> Tensor:
    """Return unit quaternions (…, 4) of rotation matrices (…, 3, 3), from the largest component (Shepperd, 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(-1) for row in matrix.unbind(-2))
    ways = torch.stack(
        [
            torch.stack([1 + a + e + i, h - f, c - g, d - b], -1),
            torch.stack([h - f, 1 + a - e - i, b + d, c + g], -1),
            torch.stack([c - g, b + d, 1 - a + e - i, f + h], -1),
            torch.stack([d - b, c + g, f + h, 1 - a - e + i], -1),
        ],
        -2,
    )
    largest = ways.diagonal(dim1=-2, dim2=-1).argmax(-1)[..., None, None].expand(*ways.shape[:-2], 1, 4)
    chosen = ways.gather(-2, largest)[..., 0, :]
    unit: Tensor = chosen / chosen.norm(dim=-1, keepdim=True)
    return unit
