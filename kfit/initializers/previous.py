"""The answer of an earlier fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import FitResult, Initializer, Observation, Variable, Variables
from kfit.core.check import check_choice, check_dict, check_list, check_names, check_range
from kfit.initializers.constant import scattered


class Previous(Initializer):
    """Start at the answer of an earlier fit, such as that of the previous frame of a video.

    A start is the answer after a step of sigma · ε, ε ~ N(0, 1), in the variable's space; the first start of each
    problem is the answer itself.

    Args:
        result: an earlier fit of the same problems, in the same order.
        on: the variables to take over; all by default.
        sigma: standard deviation of the other starts by variable, in raw units: half-turns for angles, logarithms for
            positive numbers; 0 for variables not named.

    Raises:
        ValueError: if a name is not in the result, a sigma is below 0 or of a variable not taken over, the answer is
            not finite or, when called, the number of problems differs.

    Example:
        >>> import torch, kfit
        >>> from kfit.core import Observation
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant, Previous
        >>> from kfit.optimizers import GaussNewton
        >>> template, move = Template(torch.rand(1, 8, 8), "translation"), GaussNewton({"shift": 0.02})
        >>> first, second = (Observation(torch.rand(1, 1, 8, 8)) for _ in range(2))
        >>> fit = kfit.FitPipeline(template, {"l2": L2()}, [Constant({"shift": 0.0})], move, num_starts=1)
        >>> start = Previous(fit(first), sigma={"shift": 0.05})
        >>> next_fit = kfit.FitPipeline(template, {"l2": L2()}, [start], move, num_starts=4)
        >>> next_fit(second).values["shift"].shape
        torch.Size([1, 2])
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
