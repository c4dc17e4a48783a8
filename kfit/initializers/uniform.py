"""Random starts, even between bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_range, check_text


class Uniform(Initializer):
    """Draws each number of a variable evenly from [low, high), independently for each start.

    Args:
        on: the variable.
        low, high: bounds in the units of its values (radians for angles).

    Raises:
        ValueError: if ``low`` is above ``high``.
    """

    def __init__(self, on: str, low: float, high: float) -> None:
        check_text("Uniform: on", on)
        check_range("Uniform: low", low)
        check_range("Uniform: high", high)
        if low > high:
            raise ValueError(f"Uniform: low must not be above high, got {low:g} and {high:g}")
        self.on, self.low, self.high = (on,), low, high

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        shape = variables[self.on[0]].shape
        share = torch.cat([torch.rand(num_starts, *shape, generator=rng, dtype=torch.float32) for rng in rngs])
        return {self.on[0]: self.low + (self.high - self.low) * share}
