"""Variables of a fit and the spaces that they live in.

The optimizer walks over *raw* numbers, the generator sees *values*; a space is the map between them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor

from kfit.core.check import check_count, check_list, check_range

Variables = dict[str, Tensor]


class Space(ABC):
    """Where a variable's values live, and how an optimizer walks there.

    The optimizer holds *raw* numbers and adds steps to them by `retract`; the generator sees *values*. In flat spaces
    a step is added number by number; curved ones (`kfit.core.SO3`, `kfit.core.UnitVector`) take it in the tangent
    space at the raw numbers, so that no direction is preferred and no place is singular.

    Attributes:
        radians: what a step of 1 stands for in the values' unit, where it is the same everywhere: π where raw numbers
            are half-turns, else 1.
    """

    radians: ClassVar[float] = 1.0

    @abstractmethod
    def to_value(self, raw: Tensor) -> Tensor:
        """Map raw numbers (…, \\*raw_shape) to values (…, \\*shape)."""

    @abstractmethod
    def to_raw(self, value: Tensor) -> Tensor:
        """Map values to raw numbers, the inverse of `to_value`."""

    def retract(self, raw: Tensor, step: Tensor) -> Tensor:
        """Raw numbers after a step (…, \\*raw_shape) from ``raw``; here raw + step."""
        return raw + step

    def raw_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Shape of the raw numbers and steps of one value of ``shape``; here the same.

        Raises:
            ValueError: for a shape that no value of this space has.
        """
        return shape


@dataclass(frozen=True)
class Real(Space):
    """All real numbers: value = raw."""

    def to_value(self, raw: Tensor) -> Tensor:
        return raw

    def to_raw(self, value: Tensor) -> Tensor:
        return value


@dataclass(frozen=True)
class Positive(Space):
    """Numbers above zero on a logarithmic scale: value = exp(raw), so that a step multiplies."""

    def to_value(self, raw: Tensor) -> Tensor:
        return raw.exp()

    def to_raw(self, value: Tensor) -> Tensor:
        if bool((value <= 0).any()):  # what is not a number is none in its own row alone
            raise ValueError(f"a Positive variable must be above 0, got {float(value.nan_to_num(1.0).min()):g}")
        return value.log()


@dataclass(frozen=True)
class Bounded(Space):
    """Numbers between two bounds: value = low + (high − low) · sigmoid(raw).

    Values on or outside a bound are taken a thousandth of the width inside it, where the slope is not yet zero.

    Raises:
        ValueError: if ``low`` is not below ``high``.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        check_range("Bounded: low", self.low)
        check_range("Bounded: high", self.high)
        if not self.low < self.high:
            raise ValueError(f"Bounded needs low < high, got low {self.low:g} and high {self.high:g}")

    def to_value(self, raw: Tensor) -> Tensor:
        return self.low + (self.high - self.low) * torch.sigmoid(raw)

    def to_raw(self, value: Tensor) -> Tensor:
        share = (value - self.low) / (self.high - self.low)
        return torch.logit(share.clamp(1e-3, 1 - 1e-3))


@dataclass(frozen=True)
class Angle(Space):
    """Angles: walked in half-turns, seen in radians, value = π · raw. Neither side is wrapped, so paths stay smooth."""

    radians: ClassVar[float] = math.pi

    def to_value(self, raw: Tensor) -> Tensor:
        return raw * math.pi

    def to_raw(self, value: Tensor) -> Tensor:
        return value / math.pi


@dataclass(frozen=True)
class Variable:
    """One thing that a generator can be asked to explain.

    Attributes:
        shape: shape of one value, without rows: ``()`` for a number, ``(16,)`` for a code.
        space: where its values live.

    Raises:
        TypeError, ValueError: if ``shape`` holds something but whole numbers of at least 1, ``space`` is none, or it
            has no values of that shape.
    """

    shape: tuple[int, ...] = ()
    space: Space = field(default_factory=Real)

    def __post_init__(self) -> None:
        check_list(
            "Variable: shape", self.shape, None if isinstance(self.shape, Sequence) and self.shape else 0, check_count
        )
        if not isinstance(self.space, Space):
            raise TypeError(f"Variable: space must be a kfit.core.Space, got {type(self.space).__name__}")
        self.space.raw_shape(self.shape)

    @property
    def raw_shape(self) -> tuple[int, ...]:
        """Shape of the raw numbers of one value."""
        return self.space.raw_shape(self.shape)
