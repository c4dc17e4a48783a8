"""Weights that change over the steps of a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kfit.core import Schedule
from kfit.core.arguments import check_arguments
from kfit.core.check import check_list, check_range


class Linear(Schedule):
    """A weight that changes linearly from one number to another.

    w = start + (end − start) · t, where t runs from 0 at the first step to 1 at the last.

    Args:
        start: weight at the first step.
        end: weight at the last step.

    Example:
        >>> from kfit.fitting import Linear
        >>> [Linear(1.0, 0.0)(step, 50) for step in (0, 25, 50)]
        [1.0, 0.5, 0.0]
    """

    def __init__(self, start: float, end: float) -> None:
        check_arguments(Linear, locals())
        self.start, self.end = start, end

    def __call__(self, step: int, num_steps: int) -> float:
        return self.start + (self.end - self.start) * _passed(step, num_steps)


class Cosine(Schedule):
    """A weight that changes from one number to another along half a cosine wave.

    w = end + (start − end) · (1 + cos πt) / 2, where t runs from 0 at the first step to 1 at the last.

    Source: Loshchilov and Hutter, SGDR, 2017, eq. 5.

    Args:
        start: weight at the first step.
        end: weight at the last step.

    Example:
        >>> from kfit.fitting import Cosine
        >>> [round(Cosine(1.0, 0.0)(step, 50), 2) for step in (0, 10, 25, 40, 50)]
        [1.0, 0.9, 0.5, 0.1, 0.0]
    """

    def __init__(self, start: float, end: float) -> None:
        check_arguments(Cosine, locals())
        self.start, self.end = start, end

    def __call__(self, step: int, num_steps: int) -> float:
        return self.end + (self.start - self.end) * (1 + math.cos(math.pi * _passed(step, num_steps))) / 2


class Step(Schedule):
    """A piecewise constant weight.

    Args:
        weights: one number more than jumps.
        at: fractions of the steps, from 0 to 1 and increasing, at which the next number begins.

    Raises:
        ValueError: if the numbers of weights and jumps do not match, or ``at`` does not increase from 0 to 1.

    Example:
        >>> from kfit.fitting import Step
        >>> [Step([1, 0.1], at=[0.5])(step, 50) for step in (0, 24, 25, 50)]
        [1, 1, 0.1, 0.1]
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
    """Return the fraction of the steps that are done; 1 for a fit without steps."""
    return step / num_steps if num_steps else 1.0
