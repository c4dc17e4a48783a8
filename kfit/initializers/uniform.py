"""Uniformly random starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.arguments import check_arguments


class Uniform(Initializer):
    """Draw each number of a variable uniformly from [low, high), independently for each start.

    Args:
        on: name of the variable.
        low, high: bounds in the unit of its values (radians for angles).

    Raises:
        ValueError: if ``low`` is above ``high``.

    Example:
        >>> import torch
        >>> from kfit.core import Angle, Observation, Variable
        >>> from kfit.initializers import Uniform
        >>> start, rng = Uniform("roll", -0.1, 0.1), torch.Generator().manual_seed(0)
        >>> start({"roll": Variable((), Angle())}, Observation(torch.ones(1, 3, 64, 64)), 3, [rng])["roll"]
        tensor([-0.0007,  0.0536, -0.0823])
    """

    def __init__(self, on: str, low: float, high: float) -> None:
        check_arguments(Uniform, locals())
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
