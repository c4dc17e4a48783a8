"""Records the history of a fit, drops broken rows, and collects the result."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core.check import FitError
from kfit.core.contracts import Selector
from kfit.core.result import FitResult, History
from kfit.core.state import FitState
from kfit.fitting.check_outputs import check_winner


class Recorder:
    """Collect a fit's history; used by the pipeline only.

    Args:
        num_problems: B.
        num_starts: S.
        value_stride: values are recorded at every so many steps; never if 0.
    """

    def __init__(self, num_problems: int, num_starts: int, value_stride: int = 1) -> None:
        self.num_problems, self.num_starts, self.value_stride = num_problems, num_starts, value_stride
        self.dropped: list[tuple[int, int, int]] = []
        self._steps: list[tuple[Tensor, Tensor, dict[str, Tensor], dict[str, Tensor]]] = []

    def record(self, state: FitState) -> None:
        """Record energies, terms and values of the current rows."""
        kept = self.value_stride > 0 and len(self._steps) % self.value_stride == 0
        values = state.values if kept else {}
        self._steps.append((state.problem * self.num_starts + state.start, state.energy, state.terms, values))

    def drop(self, state: FitState) -> FitState:
        """Return the state without rows whose energy is NaN or infinite, and record them in `dropped`."""
        fine = torch.isfinite(state.energy)
        if bool(fine.all()):
            return state
        lost = zip(state.problem[~fine].tolist(), state.start[~fine].tolist(), strict=True)
        self.dropped += [(problem, start, state.step) for problem, start in lost]
        return state.keep(fine)

    def result(self, state: FitState, selector: Selector, num_evaluations: int) -> FitResult:
        """Select the winners among moving and frozen rows, and return them with the history.

        Raises:
            FitError: if no rows are left.
        """
        parts = [state, *state.frozen_rows]
        problem, start = (torch.cat([getattr(part, name) for part in parts]) for name in ("problem", "start"))
        if len(problem) == 0:
            raise FitError(f"every start of every problem became NaN or infinite by step {state.step} of the fit")
        order = (problem * self.num_starts + start).argsort()
        problem, start = problem[order], start[order]
        energy = torch.cat([part.best_energy for part in parts])[order]
        values = {name: torch.cat([part.best_values[name] for part in parts])[order] for name in state.best_values}
        alive, compact = problem.unique(return_inverse=True)
        winner = selector(energy, values, compact)
        check_winner(selector, winner, compact)

        def scatter(rows: Tensor, fill: float) -> Tensor:
            whole = rows.new_full((self.num_problems, *rows.shape[1:]), fill)
            whole[alive] = rows[winner]
            return whole

        return FitResult(
            values={name: scatter(value, torch.nan) for name, value in values.items()},
            energy=scatter(energy, torch.nan),
            start=scatter(start, -1),
            all_problem=problem,
            all_start=start,
            all_energy=energy,
            all_values=values,
            history=self.history(),
            dropped=self.dropped,
            num_evaluations=num_evaluations,
        )

    def history(self) -> History:
        """Return the recorded values as tensors (T, B, S, …), with NaN where a row was removed."""
        names = sorted({name for step in self._steps for name in step[2]})
        valued = [step for step in self._steps if step[3]]
        shown = valued[0][3] if valued else {}
        return History(
            energy=self._grid([(rows, energy) for rows, energy, _, _ in self._steps]),
            # A term whose weight was 0 at a step was not computed there.
            terms={name: self._grid([(s[0], s[2].get(name)) for s in self._steps]) for name in names},
            values={name: self._grid([(s[0], s[3][name]) for s in valued]) for name in shown},
            value_stride=self.value_stride,
        )

    def _grid(self, steps: list[tuple[Tensor, Tensor | None]]) -> Tensor:
        like = next(tensor for _, tensor in steps if tensor is not None)
        grid = like.new_full((len(steps), self.num_problems * self.num_starts, *like.shape[1:]), torch.nan)
        for line, (rows, tensor) in zip(grid, steps, strict=True):
            if tensor is not None:
                line[rows] = tensor
        return grid.view(len(steps), self.num_problems, self.num_starts, *like.shape[1:])
