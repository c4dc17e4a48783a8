"""Several optimizers in succession."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.check import check_count, check_list


class Stages(Optimizer):
    """Run optimizers in succession, for example a coarse one first and a precise one to finish.

    Each starts with new memory where the previous one left the rows; the last goes on until the fit ends.

    Args:
        stages: pairs of an optimizer and its number of steps.

    Raises:
        ValueError: if there are no stages, or a number of steps is below 1.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import Adam, LBFGS, Stages
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> optimizer = Stages([(Adam(0.05), 10), (LBFGS(), 40)])
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, optimizer, num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, stages: Sequence[tuple[Optimizer, int]]) -> None:
        check_list("Stages: stages", stages, None, _check_stage)
        self.stages = list(stages)

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        first, *_ = [optimizer.init(raw, seeds) for optimizer, _ in self.stages]  # the others check names here too
        return {"stage": 0, "taken": 0, "seeds": seeds, "inner": first}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        stage, taken, inner = memory["stage"], memory["taken"], memory["inner"]
        if taken == self.stages[stage][1] and stage + 1 < len(self.stages):
            stage, taken = stage + 1, 0
            # Random numbers must differ from those of the first stage.
            inner = self.stages[stage][0].init(raw, memory["seeds"] ^ stage)
        new, evaluation, inner = self.stages[stage][0].step(evaluate, raw, problem, inner)
        return new, evaluation, {"stage": stage, "taken": taken + 1, "seeds": memory["seeds"], "inner": inner}


def _check_stage(name: str, stage: Any) -> None:
    """Refuse anything but a pair of an optimizer and its number of steps."""
    check_list(name, stage, 2, lambda *_: None)
    if not isinstance(stage[0], Optimizer):
        raise TypeError(f"{name} must begin with an optimizer each, got {type(stage[0]).__name__}")
    check_count(f"{name}: steps of {type(stage[0]).__name__}", stage[1])
