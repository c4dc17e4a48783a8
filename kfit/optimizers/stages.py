"""One optimizer after another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor, nn

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.check import check_count, check_list


class Stages(Optimizer):
    """Lets optimizers take turns: coarse to fine, or a careful one to finish what a bold one began.

    Each begins afresh where the one before has left the rows; the last goes on as long as the fit does.

    Args:
        stages: optimizers and the number of steps that each takes.

    Raises:
        ValueError: for no stages and for numbers of steps below 1.
    """

    def __init__(self, stages: Sequence[tuple[Optimizer, int]]) -> None:
        check_list("Stages: stages", stages, None, _check_stage)
        self.stages = list(stages)

    @property
    def networks(self) -> list[nn.Module]:
        return [network for optimizer, _ in self.stages for network in optimizer.networks]

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        first, *_ = [optimizer.init(raw, seeds) for optimizer, _ in self.stages]  # the others' names are checked too
        return {"stage": 0, "taken": 0, "seeds": seeds, "inner": first}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        stage, taken, inner = memory["stage"], memory["taken"], memory["inner"]
        if taken == self.stages[stage][1] and stage + 1 < len(self.stages):
            stage, taken = stage + 1, 0
            # Other random numbers than the first stage's.
            inner = self.stages[stage][0].init(raw, memory["seeds"] ^ stage)
        new, seen, inner = self.stages[stage][0].step(evaluate, raw, problem, inner)
        return new, seen, {"stage": stage, "taken": taken + 1, "seeds": memory["seeds"], "inner": inner}


def _check_stage(name: str, stage: Any) -> None:
    """Refuse what is no pair of an optimizer and its number of steps."""
    check_list(name, stage, 2, lambda *_: None)
    if not isinstance(stage[0], Optimizer):
        raise TypeError(f"{name} must begin with an optimizer each, got {type(stage[0]).__name__}")
    check_count(f"{name}: steps of {type(stage[0]).__name__}", stage[1])
