"""Early stopping of single problems."""

from __future__ import annotations

from dataclasses import replace

import torch

from kfit.core import Callback, FitState
from kfit.core.arguments import check_arguments

BEST, SINCE = "stopping: energy", "stopping: steps"


class Stopping(Callback):
    """Stop a problem's fit if its best energy has not decreased for some steps; the others continue.

    The least ranking energy E of a problem's starts counts as decreased if it is below (1 − tolerance) · |E| of when it
    last did; a start that became NaN or infinite no longer counts. A stopped problem costs nothing more, and its starts
    stay among the answers.

    Args:
        tolerance: relative decrease of the energy that counts, in [0, 1).
        patience: consecutive steps without such a decrease after which the problem is stopped.

    Raises:
        ValueError: if the tolerance is outside [0, 1), or the patience is below 1.

    Example:
        >>> import torch, kfit
        >>> from kfit.callbacks import Stopping
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Uniform
        >>> from kfit.optimizers import Adam
        >>> fit = kfit.FitPipeline(
        ...     Template(torch.rand(1, 16, 16), "translation"),
        ...     energies={"l2": L2()},
        ...     initializers=[Uniform("shift", -0.2, 0.2)],
        ...     optimizer=Adam(0.02),
        ...     callbacks=[Stopping(tolerance=0.01, patience=3)],
        ...     num_starts=8,
        ...     num_steps=20,
        ... )
        >>> result = fit(kfit.Observation(torch.zeros(1, 1, 16, 16)))
        >>> len(result.history.energy) <= 21
        True
    """

    def __init__(self, tolerance: float = 0.001, patience: int = 3) -> None:
        check_arguments(Stopping, locals(), tolerance=(0, 1 - 1e-9))
        self.tolerance, self.patience = tolerance, patience

    def on_step(self, state: FitState) -> FitState:
        # Both belong to the problem, and are stored with each of its rows.
        count = int(state.problem.max()) + 1 if len(state.problem) else 0
        least = state.best_energy.new_full((count,), torch.inf)
        least = least.scatter_reduce(0, state.problem, state.best_energy, "amin")[state.problem]
        before = state.notes.get(BEST, torch.full_like(least, torch.inf))
        since = state.notes.get(SINCE, torch.zeros_like(least))
        # It rises only if the best start was dropped; the remaining starts then have their own best.
        fallen = (least < before - self.tolerance * before.abs()) | before.isinf() | (least > before)
        since = torch.where(fallen, 0.0, since + 1)
        notes = {**state.notes, BEST: torch.where(fallen, least, before), SINCE: since}
        return replace(state, notes=notes).freeze(since >= self.patience)
