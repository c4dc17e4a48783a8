"""The result of a fit: winners, other starts, and their history."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.variables import Variables


@dataclass
class History:
    """Energies and values of each start at each step; NaN after a row was removed (pruned or dropped).

    Attributes:
        energy: (T, B, S).
        terms: (T, B, S) each, unweighted; NaN also at steps at which a term had no weight and was not computed.
        values: (T′, B, S, \\*shape) each, at the steps 0, k, 2k, … where k is ``value_stride``.
        value_stride: k; 0 if no values were recorded.
    """

    energy: Tensor
    terms: dict[str, Tensor]
    values: Variables
    value_stride: int = 1


@dataclass
class FitResult:
    """Result of a fit of B problems.

    Attributes:
        values: the winners, (B, \\*shape) each; NaN for a problem whose starts all failed.
        energy: (B,) their ranking energy.
        start: (B,) number of the start that won, −1 if all failed.
        all_problem, all_start, all_energy, all_values: the R surviving starts, winners and alternatives.
        history: energies and values of each start at each step.
        dropped: (problem, start, step) of each row that became NaN or infinite.
        num_evaluations: number of pictures that the generator drew.

    Example:
        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Uniform
        >>> from kfit.optimizers import Adam
        >>> template, start = Template(torch.rand(1, 16, 16), "translation"), Uniform("shift", -0.2, 0.2)
        >>> fit = kfit.FitPipeline(template, {"l2": L2()}, [start], Adam(0.02), num_starts=4, num_steps=5)
        >>> result = fit(kfit.Observation(torch.rand(2, 1, 16, 16)))  # two problems
        >>> result.values["shift"].shape, result.all_values["shift"].shape, result.history.energy.shape
        (torch.Size([2, 2]), torch.Size([8, 2]), torch.Size([6, 2, 4]))
        >>> result[1].energy == result.energy[1]
        tensor([True])
    """

    values: Variables
    energy: Tensor
    start: Tensor
    all_problem: Tensor = field(repr=False)
    all_start: Tensor = field(repr=False)
    all_energy: Tensor = field(repr=False)
    all_values: Variables = field(repr=False)
    history: History = field(repr=False)
    dropped: list[tuple[int, int, int]] = field(default_factory=list)
    num_evaluations: int = 0

    def to(self, device: str | torch.device) -> FitResult:
        """Return the result on another device."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        history = {f.name: getattr(self.history, f.name) for f in fields(self.history)}
        moved = pytree.tree_map_only(Tensor, lambda tensor: tensor.to(device), (held, history))
        return FitResult(**{**moved[0], "history": History(**moved[1])})

    def __len__(self) -> int:
        """B, the number of problems."""
        return len(self.energy)

    def __iter__(self) -> Iterator[FitResult]:
        """The problems one by one."""
        return (self[problem] for problem in range(len(self)))

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
