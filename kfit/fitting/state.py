"""The state of a fit at its beginning, and after each step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from kfit.core import Evaluation, FitState, Variables
from kfit.core.rows import broadcast_rows, finite


def first_state(raw: Variables, memory: Any, num_problems: int, num_starts: int, num_steps: int) -> FitState:
    """The state before the first step.

    Args:
        raw: (B · S, \\*shape) of each variable.
        memory: memory of the optimizer.
        num_problems, num_starts, num_steps: B, S and the steps planned.
    """
    first = next(iter(raw.values()))
    problem = torch.arange(num_problems, device=first.device).repeat_interleave(num_starts)
    start = torch.arange(num_starts, device=first.device).repeat(num_problems)
    nothing = first.new_full((len(problem),), torch.inf)
    return FitState(0, num_steps, problem, start, raw, {}, nothing, {}, nothing, {}, memory)


def advanced(state: FitState, step: int, new: Variables, found: Evaluation, memory: Any) -> FitState:
    """The state after a step; the energy of rows that are no longer finite is NaN.

    Args:
        state: before.
        step: number of steps taken.
        new: raw variables after the step.
        found: the evaluation before it.
        memory: memory of the optimizer.
    """
    better = found.ranking < state.best_energy  # False where the energy is NaN
    best = {
        name: value
        if not state.best_values
        else torch.where(broadcast_rows(better, value), value, state.best_values[name])
        for name, value in found.values.items()
    }
    broken = ~(torch.isfinite(found.energy) & finite(new))
    return replace(
        state,
        step=step,
        raw=new,
        values=found.values,
        energy=torch.where(broken, torch.nan, found.energy),
        terms=found.terms,
        best_energy=torch.where(better, found.ranking, state.best_energy),
        best_values=best,
        optimizer=memory,
    )
