"""Leaving problems alone that get no better."""

from __future__ import annotations

from dataclasses import replace

import torch

from kfit.core import Callback, FitState
from kfit.core.check import check_count, check_range

BEST, SINCE = "stopping: energy", "stopping: steps"


class Stopping(Callback):
    """Ends a problem's fit when its best energy has not fallen for some steps; the others go on without it.

    The least ranking energy E of a problem's starts counts as fallen where it is below (1 − tolerance) · |E| of when
    it last did; a start that became NaN or infinite no longer counts. A problem that is stopped costs nothing more, and
    its starts stay among the answers.

    Args:
        tolerance: share by which the energy must fall.
        patience: steps in a row without that after which the problem is stopped.

    Raises:
        ValueError: for a tolerance outside [0, 1), or a patience below 1.
    """

    def __init__(self, tolerance: float = 0.001, patience: int = 3) -> None:
        check_range("Stopping: tolerance", tolerance, 0, 1 - 1e-9)
        check_count("Stopping: patience", patience)
        self.tolerance, self.patience = tolerance, patience

    def on_step(self, state: FitState) -> FitState:
        # Both are of the problem, written beside each of its rows.
        count = int(state.problem.max()) + 1 if len(state.problem) else 0
        least = state.best_energy.new_full((count,), torch.inf)
        least = least.scatter_reduce(0, state.problem, state.best_energy, "amin")[state.problem]
        before = state.notes.get(BEST, torch.full_like(least, torch.inf))
        since = state.notes.get(SINCE, torch.zeros_like(least))
        # It only rises where the best start broke and was dropped: then the others have a best of their own to beat.
        fallen = (least < before - self.tolerance * before.abs()) | before.isinf() | (least > before)
        since = torch.where(fallen, 0.0, since + 1)
        notes = {**state.notes, BEST: torch.where(fallen, least, before), SINCE: since}
        return replace(state, notes=notes).freeze(since >= self.patience)
