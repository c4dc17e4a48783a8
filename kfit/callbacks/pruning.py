"""Removal of the starts that are unlikely to win."""

from __future__ import annotations

from kfit.core import Callback, FitState
from kfit.core.check import check_count, check_dict
from kfit.core.rows import best_first


class Pruning(Callback):
    """Keep only the best starts of each problem at given steps (successive halving, Jamieson and Talwalkar 2016).

    A survivor takes the same path as without pruning.

    Args:
        keep: step → number of starts that survive it, ranked by best-so-far energy.

    Raises:
        ValueError: if a count is below 1.

    Example:
        >>> import torch, kfit
        >>> from kfit.callbacks import Pruning
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Uniform
        >>> from kfit.optimizers import Adam
        >>> fit = kfit.FitPipeline(
        ...     Template(torch.rand(1, 16, 16), "translation"),
        ...     energies={"l2": L2()},
        ...     initializers=[Uniform("shift", -0.2, 0.2)],
        ...     optimizer=Adam(0.02),
        ...     callbacks=[Pruning({5: 4, 10: 1})],
        ...     num_starts=8,
        ...     num_steps=20,
        ... )
        >>> result = fit(kfit.Observation(torch.rand(1, 1, 16, 16)))
        >>> result.num_evaluations  # 6 steps of 8 rows, 5 of 4, 10 of 1, and not 21 of 8
        78
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
