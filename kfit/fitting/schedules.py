"""Weights that change over the steps of a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kfit.core import Schedule
from kfit.core.check import check_list, check_range


class Linear(Schedule):
    """A weight that goes evenly from one number to another.

    w = start + (end − start) · t, where t runs from 0 at the first step to 1 at the last.

    Args:
        start: weight at the first step.
        end: weight at the last step.
    """

    def __init__(self, start: float, end: float) -> None:
        check_range("start", start)
        check_range("end", end)
        self.start, self.end = start, end

    def __call__(self, step: int, num_steps: int) -> float:
        return self.start + (self.end - self.start) * _passed(step, num_steps)


class Cosine(Schedule):
    """A weight that leaves one number slowly and comes slowly to another.

    w = end + (start − end) · (1 + cos πt) / 2, where t runs from 0 at the first step to 1 at the last.

    Source: Loshchilov and Hutter, SGDR, 2017, eq. 5.

    Args:
        start: weight at the first step.
        end: weight at the last step.
    """

    def __init__(self, start: float, end: float) -> None:
        check_range("start", start)
        check_range("end", end)
        self.start, self.end = start, end

    def __call__(self, step: int, num_steps: int) -> float:
        return self.end + (self.start - self.end) * (1 + math.cos(math.pi * _passed(step, num_steps))) / 2


class Step(Schedule):
    """A weight that jumps: first the first of its numbers, then the next from each share of the steps on.

    ``Step([1, 0.1], at=[0.5])`` is 1 in the first half of a fit and 0.1 in the second.

    Args:
        weights: one number more than jumps.
        at: shares of the steps, from 0 to 1 and rising, at which it jumps.

    Raises:
        ValueError: if their numbers do not go together, or the shares do not rise from 0 to 1.
    """

    def __init__(self, weights: Sequence[float], at: Sequence[float]) -> None:
        check_list("weights", weights, None, check_range)
        check_list("at, one number fewer than weights,", at, len(weights) - 1, check_range, 0, 1)
        if list(at) != sorted(at):
            raise ValueError(f"at must rise, got {list(at)}")
        self.weights, self.at = tuple(weights), tuple(at)

    def __call__(self, step: int, num_steps: int) -> float:
        passed = _passed(step, num_steps)
        return self.weights[sum(share <= passed for share in self.at)]


def _passed(step: int, num_steps: int) -> float:
    """Share of the steps that lie behind; a fit of no steps is at its end."""
    return step / num_steps if num_steps else 1.0
