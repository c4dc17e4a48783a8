"""The contracts: read these few files of ``kfit/core`` and you know the design.

A *generator* (``generator.py``) draws a picture from named variables. An *energy* (``energy.py``) measures how badly
the picture explains an observation (``observation.py``), a *prior* (``prior.py``) how unlikely values of variables are.
*Initializers* set initial values, an *optimizer* moves them, a *selector* picks the winner, *callbacks* observe: they
are here. A `kfit.FitPipeline` holds them together. A fit has N **rows**, each one start of one problem; problems may
have different numbers of rows (``state.py``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from kfit.core.evaluate import Evaluate
from kfit.core.observation import Observation
from kfit.core.part import Part
from kfit.core.result import FitResult
from kfit.core.state import Evaluation, FitState
from kfit.core.variables import Variable, Variables


class Initializer(Part, ABC):
    """Sets the initial values of some variables.

    Attributes:
        on: names of the variables that it sets together.

    Example:
        >>> import torch, kfit
        >>> class Dark(kfit.Initializer):
        ...     on = ("level",)
        ...
        ...     def __call__(self, variables, observation, num_starts, rngs):
        ...         noise = [0.1 * torch.rand(num_starts, generator=rng) for rng in rngs]
        ...         return {"level": torch.cat(noise)}
        >>> observation = kfit.Observation(torch.ones(2, 3, 8, 8))
        >>> Dark()({"level": kfit.Variable()}, observation, 5, [torch.Generator() for _ in range(2)])["level"].shape
        torch.Size([10])
    """

    on: tuple[str, ...]

    @abstractmethod
    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        """Return values (B·S, \\*shape) of its variables, the S starts of a problem consecutively.

        Args:
            variables: those of the generator.
            observation: B problems.
            num_starts: S.
            rngs: one generator of random numbers (on the CPU) for each problem.
        """


class Optimizer(Part, ABC):
    """Moves rows downhill. Stateless: its memory is a value in which every tensor leads with rows.

    Example:
        >>> import torch, kfit
        >>> class GradientDescent(kfit.Optimizer):
        ...     def init(self, raw, seeds):
        ...         return None
        ...
        ...     def step(self, evaluate, raw, problem, memory):
        ...         evaluation = evaluate(raw, problem, need="gradient")
        ...         step = {name: -0.1 * slope for name, slope in evaluation.gradient.items()}
        ...         return evaluate.retract(raw, step), evaluation, memory
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> template, start = Template(torch.rand(1, 8, 8), "translation"), [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(template, {"l2": L2()}, start, GradientDescent(), num_starts=1)
        >>> fit(kfit.Observation(torch.rand(1, 1, 8, 8))).num_evaluations  # 50 steps, and the last iterate
        51
    """

    @abstractmethod
    def init(self, raw: Variables, seeds: Tensor) -> Any:
        """Return the memory for these rows.

        Args:
            raw: (N, \\*shape) each.
            seeds: (N,) whole numbers that determine each row's random numbers, whatever the other rows are.

        Raises:
            ValueError: if its settings name unknown variables.
        """

    @abstractmethod
    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        """Take one step; return the new raw variables, the evaluation *at the old ones*, and the new memory."""


class Callback(Part):
    """Observes a fit, and may remove or freeze rows.

    Example:
        >>> import kfit
        >>> class Log(kfit.Callback):
        ...     def on_step(self, state: kfit.FitState) -> kfit.FitState:
        ...         print(state.step, float(state.best_energy.min()))
        ...         return state
    """

    def on_start(self, state: FitState) -> None:
        """Called once, before the first step."""

    def on_step(self, state: FitState) -> FitState:
        """Called after each evaluation; the fit continues with the returned state."""
        return state

    def on_end(self, result: FitResult) -> None:
        """Called once, with the result."""


class Selector(Part, ABC):
    """Selects the winner of each problem.

    Example:
        >>> import torch, kfit
        >>> class First(kfit.Selector):
        ...     def __call__(self, energy, values, problem):
        ...         numbers = torch.arange(int(problem.max()) + 1)
        ...         return (problem == numbers[:, None]).int().argmax(1)
        >>> First()(torch.tensor([0.3, 0.1, 0.2]), {}, torch.tensor([0, 0, 1]))
        tensor([0, 2])
    """

    @abstractmethod
    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        """Return the row (B,) that wins each problem, of R rows in any order; each problem 0…B−1 has at least one."""


class Schedule(Part, ABC):
    """A term's weight that changes over the steps.

    Example:
        >>> import kfit
        >>> class Late(kfit.Schedule):
        ...     def __call__(self, step: int, num_steps: int) -> float:
        ...         return float(step > num_steps / 2)
        >>> Late()(10, 50), Late()(40, 50)
        (0.0, 1.0)
    """

    @abstractmethod
    def __call__(self, step: int, num_steps: int) -> float:
        """Return the weight at ``step`` (0 … num_steps)."""
