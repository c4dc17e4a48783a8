"""Where the last picture's fit ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import FitResult, Initializer, Observation, Variable, Variables
from kfit.core.check import check_choice, check_dict, check_list, check_names, check_range
from kfit.initializers.constant import scattered


class Previous(Initializer):
    """Starts at an earlier fit's answer, such as the frame before in a video.

    A start is the answer after a step of sigma · ε, ε ~ N(0, 1), in the variable's space; the first start of each
    problem takes the answer itself.

    Args:
        result: of as many problems as will be fitted, problem by problem the same objects.
        on: the variables to take over; all unless given.
        sigma: standard deviation of the other starts by variable, where the optimizer walks: in half-turns for
            angles, in logarithms for positive numbers; 0 for variables not named.

    Raises:
        ValueError: for names that the result does not have, a sigma of a variable not taken over or below 0, an
            answer that is not finite and, when it is called, another number of problems.
    """

    def __init__(
        self, result: FitResult, on: Sequence[str] | None = None, sigma: dict[str, float] | None = None
    ) -> None:
        if on is not None:
            check_list("Previous: on", on, None, check_choice, result.values)
        self.on, self.sigma = tuple(result.values if on is None else on), {} if sigma is None else sigma
        check_dict("Previous: sigma", self.sigma, check_range, 0)
        check_names("Previous: sigma", self.sigma, self.on)
        self.values = {name: result.values[name].detach() for name in self.on}
        for name, value in self.values.items():
            if not bool(value.isfinite().all()):
                raise ValueError(f"Previous: {name} of a problem is not finite, as after a fit that failed; start anew")

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        started = {}
        for name, value in self.values.items():
            if len(value) != observation.num_problems:
                count = observation.num_problems
                raise ValueError(f"Previous: the result holds {len(value)} problems, the observation {count}")
            started[name] = scattered(value, variables[name], self.sigma.get(name, 0.0), num_starts, rngs)
        return started
