"""Dropping the starts that are unlikely to win."""

from __future__ import annotations

from kfit.core import Callback, FitState
from kfit.core.check import check_count, check_dict
from kfit.core.rows import best_first


class Pruning(Callback):
    """Keeps, at given steps, only the best starts of each problem (successive halving, Jamieson and Talwalkar 2016).

    A survivor walks the path that it would have walked without pruning.

    Args:
        keep: step → number of starts that survive it, judged by best-so-far energy.

    Raises:
        ValueError: for a count below 1.
    """

    def __init__(self, keep: dict[int, int]) -> None:
        check_dict("Pruning: keep", keep, check_count, keys=int)
        for step in keep:
            check_count("Pruning: step of keep", step, 0)
        self.keep = keep

    def on_step(self, state: FitState) -> FitState:
        if state.step not in self.keep:
            return state
        order, place = best_first(state.best_energy, state.problem)
        return state.keep(order[place < self.keep[state.step]].sort().values)
