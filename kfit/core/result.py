"""What a fit found: the winners, the other starts, and what each did."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.variables import Variables


@dataclass
class History:
    """What each start did at each step; rows that left (pruned, dropped) hold NaN from then on.

    Attributes:
        energy: (T, B, S).
        terms: (T, B, S) each, unweighted; NaN also at steps at which a term had no weight and was not computed.
        values: (T′, B, S, \\*shape) each, at the steps 0, k, 2k, … where k is ``value_stride``.
        value_stride: k; 0 where no values were recorded.
    """

    energy: Tensor
    terms: dict[str, Tensor]
    values: Variables
    value_stride: int = 1


@dataclass
class FitResult:
    """What a fit found for B problems.

    Attributes:
        values: the winners, (B, \\*shape) each; NaN for a problem all of whose starts failed.
        energy: (B,) their ranking energy.
        start: (B,) the number of the start that won, −1 where all failed.
        all_problem, all_start, all_energy, all_values: the surviving starts, R rows: the alternatives.
        history: every start at every step.
        dropped: (problem, start, step) of each row that became NaN or infinite.
        num_evaluations: number of pictures that the generator drew.
    """

    values: Variables
    energy: Tensor
    start: Tensor
    all_problem: Tensor
    all_start: Tensor
    all_energy: Tensor
    all_values: Variables
    history: History
    dropped: list[tuple[int, int, int]] = field(default_factory=list)
    num_evaluations: int = 0

    def to(self, device: str | torch.device) -> FitResult:
        """The same on another device."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        history = {f.name: getattr(self.history, f.name) for f in fields(self.history)}
        moved = pytree.tree_map_only(Tensor, lambda tensor: tensor.to(device), (held, history))
        return FitResult(**{**moved[0], "history": History(**moved[1])})

    def __len__(self) -> int:
        """B, the number of problems."""
        return len(self.energy)

    def __getitem__(self, problem: int) -> FitResult:
        """One problem, which becomes problem 0 of the result: winner, starts, history and dropped rows.

        ``num_evaluations`` stays the number of pictures that were drawn for all problems, because pictures of several
        problems are drawn together.

        Raises:
            IndexError: for a number that is not from 0 to B − 1.
        """
        if not 0 <= problem < len(self):
            raise IndexError(f"problem must lie between 0 and {len(self) - 1}, got {problem}")
        one, rows = slice(problem, problem + 1), self.all_problem == problem
        path = self.history
        return replace(
            self,
            values=_taken(self.values, one),
            energy=self.energy[one],
            start=self.start[one],
            all_problem=torch.zeros_like(self.all_problem[rows]),
            all_start=self.all_start[rows],
            all_energy=self.all_energy[rows],
            all_values=_taken(self.all_values, rows),
            history=replace(
                path,
                energy=path.energy[:, one],
                terms={name: term[:, one] for name, term in path.terms.items()},
                values={name: value[:, one] for name, value in path.values.items()},
            ),
            dropped=[(0, start, step) for number, start, step in self.dropped if number == problem],
        )


def _taken(values: Variables, rows: slice | Tensor) -> Variables:
    return {name: value[rows] for name, value in values.items()}
