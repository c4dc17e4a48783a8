"""Where a fit stands: energies of rows, and the rows themselves."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.observation import Rendering
from kfit.core.variables import Variables


@dataclass
class Evaluation:
    """Energies of rows.

    Attributes:
        energy: (N,) weighted sum that is descended.
        ranking: (N,) weighted sum by which starts are ranked.
        terms: (N,) each, unweighted.
        values: what the generator saw, (N, \\*shape) each.
        rendering: what was drawn, N pictures.
    """

    energy: Tensor
    ranking: Tensor
    terms: dict[str, Tensor]
    values: Variables
    rendering: Rendering | None = None


@dataclass(kw_only=True)
class GradientEvaluation(Evaluation):
    """Energies of rows and their slopes.

    Attributes:
        gradient: of the sum of ``energy`` over rows with respect to raw variables.
    """

    gradient: Variables


@dataclass(kw_only=True)
class ResidualEvaluation(Evaluation):
    """Energies of rows as sums of squares.

    Attributes:
        residuals: (N, M) whose squares sum to ``energy``.
    """

    residuals: Tensor


@dataclass
class FitState:
    """Where a fit stands: N rows, each one start of one problem.

    Attributes:
        step: number of steps taken.
        num_steps: number of steps planned.
        problem, start: (N,) the row's problem and the number that its start had at the beginning.
        raw: variables as the optimizer walks on them, (N, \\*shape) each.
        values: the same as the generator saw them at the last evaluation.
        energy: (N,) descended energy at the last evaluation.
        terms: (N,) each, the unweighted energies by name.
        best_energy, best_values: least ranking energy so far of each row, and the values that reached it.
        optimizer: memory of the optimizer, a pytree whose tensors lead with rows.
        notes: what callbacks remember of the rows, (N, …) each by a name of theirs; so they hold nothing themselves.
        frozen_rows: rows that have stopped moving and still may win; see `freeze`.
    """

    step: int
    num_steps: int
    problem: Tensor
    start: Tensor
    raw: Variables
    values: Variables
    energy: Tensor
    terms: dict[str, Tensor]
    best_energy: Tensor
    best_values: Variables
    optimizer: Any
    notes: dict[str, Tensor] = field(default_factory=dict)
    frozen_rows: tuple[FitState, ...] = ()

    def keep(self, index: Tensor) -> FitState:
        """The same state with the rows of ``index`` (long or boolean) only; start numbers survive."""
        if index.dtype == torch.bool:
            index = index.nonzero()[:, 0]
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        kept = pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, index), held)
        return FitState(**kept)

    def freeze(self, rows: Tensor) -> FitState:
        """The state without these rows (N,), boolean, which cost nothing from now on and stay among the answers."""
        if not bool(rows.any()):
            return self
        return replace(self.keep(~rows), frozen_rows=(*self.frozen_rows, replace(self.keep(rows), frozen_rows=())))
