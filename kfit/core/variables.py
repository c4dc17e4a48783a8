"""Variables of a fit and the spaces they live in.

The optimizer moves *raw* numbers, the generator takes *values*; a space is the map between them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor

from kfit.core.arguments import check_arguments
from kfit.core.check import check_count, check_list

Variables = dict[str, Tensor]


class Space(ABC):
    """Set of a variable's values, and the parametrisation in which an optimizer moves.

    The optimizer stores *raw* numbers and adds steps to them by `retract`; the generator takes *values*. In flat spaces
    a step is added to the raw numbers; in curved ones (`kfit.core.SO3`, `kfit.core.UnitVector`) it lies in the tangent
    space at the raw numbers, so that no direction is preferred and no point is singular.

    Attributes:
        radians: length of a step of 1 in the values' unit, if it is the same everywhere: π if raw numbers are
            half-turns, else 1.

    Example:
        >>> import torch
        >>> from kfit.core import Positive
        >>> space = Positive()
        >>> raw = space.to_raw(torch.tensor([2.0]))
        >>> space.to_value(space.retract(raw, torch.tensor([0.1])))  # 2 · exp(0.1)
        tensor([2.2103])
    """

    radians: ClassVar[float] = 1.0

    @abstractmethod
    def to_value(self, raw: Tensor) -> Tensor:
        """Map raw numbers (…, \\*raw_shape) to values (…, \\*shape)."""

    @abstractmethod
    def to_raw(self, value: Tensor) -> Tensor:
        """Map values to raw numbers, the inverse of `to_value`."""

    def retract(self, raw: Tensor, step: Tensor) -> Tensor:
        """Return the raw numbers after a step (…, \\*raw_shape) from ``raw``; here raw + step."""
        return raw + step

    def raw_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of the raw numbers and steps of one value of ``shape``; here the same.

        Raises:
            ValueError: if no value of this space has that shape.
        """
        return shape


@dataclass(frozen=True)
class Real(Space):
    """All real numbers: value = raw.

    Example:
        >>> import torch
        >>> from kfit.core import Real
        >>> Real().to_value(torch.tensor([-3.0]))
        tensor([-3.])
    """

    def to_value(self, raw: Tensor) -> Tensor:
        return raw

    def to_raw(self, value: Tensor) -> Tensor:
        return value


@dataclass(frozen=True)
class Positive(Space):
    """Positive numbers on a logarithmic scale: value = exp(raw), so that a step multiplies.

    Example:
        >>> import torch
        >>> from kfit.core import Positive
        >>> Positive().to_value(torch.tensor([-3.0, 0.0, 3.0]))
        tensor([ 0.0498,  1.0000, 20.0855])
    """

    def to_value(self, raw: Tensor) -> Tensor:
        return raw.exp()

    def to_raw(self, value: Tensor) -> Tensor:
        if bool((value <= 0).any()):  # NaN stays NaN in its own row
            raise ValueError(f"a Positive variable must be above 0, got {float(value.nan_to_num(1.0).min()):g}")
        return value.log()


@dataclass(frozen=True)
class Bounded(Space):
    """Numbers between two bounds: value = low + (high − low) · sigmoid(raw).

    Values on or outside a bound are moved 0.001 × the width inside, where the slope is not 0 yet.

    Raises:
        ValueError: if ``low`` is not below ``high``.

    Example:
        >>> import torch
        >>> from kfit.core import Bounded
        >>> Bounded(0.0, 10.0).to_value(torch.tensor([-3.0, 0.0, 3.0]))
        tensor([0.4743, 5.0000, 9.5257])
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        check_arguments(Bounded, vars(self))
        if not self.low < self.high:
            raise ValueError(f"Bounded needs low < high, got low {self.low:g} and high {self.high:g}")

    def to_value(self, raw: Tensor) -> Tensor:
        return self.low + (self.high - self.low) * torch.sigmoid(raw)

    def to_raw(self, value: Tensor) -> Tensor:
        share = (value - self.low) / (self.high - self.low)
        return torch.logit(share.clamp(1e-3, 1 - 1e-3))


@dataclass(frozen=True)
class Angle(Space):
    """Angles: raw numbers in half-turns, values in radians, value = π · raw. Neither is wrapped: paths are smooth.

    Example:
        >>> import torch
        >>> from kfit.core import Angle
        >>> Angle().to_value(torch.tensor([0.5]))
        tensor([1.5708])
    """

    radians: ClassVar[float] = math.pi

    def to_value(self, raw: Tensor) -> Tensor:
        return raw * math.pi

    def to_raw(self, value: Tensor) -> Tensor:
        return value / math.pi


@dataclass(frozen=True)
class Variable:
    """An input of a generator that a fit can find.

    Attributes:
        shape: shape of one value, without rows: ``()`` for a number, ``(16,)`` for a code.
        space: the space of its values.

    Raises:
        TypeError, ValueError: if ``shape`` holds anything but whole numbers of at least 1, ``space`` is not a `Space`,
            or the space has no values of that shape.

    Example:
        >>> from kfit.core import SO3, Variable
        >>> Variable((16,))
        Variable(shape=(16,), space=Real())
        >>> Variable((3, 3), SO3()).raw_shape  # a rotation vector
        (3,)
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
