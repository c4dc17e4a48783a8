"""State of a fit: energies of rows, and the rows themselves."""

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
    """Energies of N rows.

    Attributes:
        energy: (N,) weighted sum that the optimizer minimises.
        ranking: (N,) weighted sum by which starts are ranked.
        terms: (N,) each, unweighted.
        values: the generator's inputs, (N, \\*shape) each.
        rendering: the N drawn pictures.
    """

    energy: Tensor
    ranking: Tensor
    terms: dict[str, Tensor]
    values: Variables
    rendering: Rendering | None = None


@dataclass(kw_only=True)
class GradientEvaluation(Evaluation):
    """Energies of N rows and their gradient.

    Attributes:
        gradient: gradient of the sum of ``energy`` over rows with respect to raw variables.
    """

    gradient: Variables


@dataclass(kw_only=True)
class ResidualEvaluation(Evaluation):
    """Energies of N rows as sums of squares.

    Attributes:
        residuals: (N, M) whose squares sum to ``energy``.
    """

    residuals: Tensor


@dataclass(kw_only=True)
class PicturesEvaluation(Evaluation):
    """Energies of N rows and the observed pictures.

    Attributes:
        observed: fields of the observation, such as ``image`` and ``mask``, for each drawn picture.
    """

    observed: dict[str, Tensor]


@dataclass
class FitState:
    """State of a fit: N rows, each one start of one problem.

    Attributes:
        step: number of steps taken.
        num_steps: number of steps planned.
        problem, start: (N,) the row's problem and the original number of its start.
        raw: raw variables, which the optimizer moves, (N, \\*shape) each.
        values: the generator's inputs at the last evaluation.
        energy: (N,) minimised energy at the last evaluation.
        terms: (N,) each, the unweighted energies by name.
        best_energy, best_values: least ranking energy so far of each row, and its values.
        optimizer: memory of the optimizer, a pytree whose tensors lead with rows.
        notes: data of callbacks about the rows, (N, …) each by a name of their choice, so that callbacks are stateless.
        frozen_rows: rows that no longer move and can still win; see `freeze`.

    Example:
        A callback that keeps the best half of all rows:

        >>> import kfit
        >>> class BestHalf(kfit.Callback):
        ...     def on_step(self, state: kfit.FitState) -> kfit.FitState:
        ...         return state.keep(state.best_energy <= state.best_energy.median())
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
        """Return the state with the rows of ``index`` (long or boolean) only; start numbers are kept."""
        if index.dtype == torch.bool:
            index = index.nonzero()[:, 0]
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        kept = pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, index), held)
        return FitState(**kept)

    def freeze(self, rows: Tensor) -> FitState:
        """Return the state without these rows (N,), boolean, which cost nothing from now on and can still win."""
        if not bool(rows.any()):
            return self
        return replace(self.keep(~rows), frozen_rows=(*self.frozen_rows, replace(self.keep(rows), frozen_rows=())))
