"""Gauss–Newton by differences, for few variables that begin near their answer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.check import check_dict, check_names, check_range
from kfit.core.rows import pictures_of
from kfit.optimizers.flat import flatten, repeated, unflatten


class GaussNewton(Optimizer):
    """Solves the energies' linear model at each step, without gradients, for energies that are sums of squares.

    δ solves (JᵀJ + λ·diag JᵀJ) δ = −Jᵀr, with the Jacobian J of the residuals r by forward differences, one picture for
    each of the P numbers of a row: a step draws 1 + P pictures a row and asks for no slope. Differences as long as the
    steps that are hoped for look across what is rough in between. Nothing is tried out: unlike
    `kfit.optimizers.LevenbergMarquardt` it may climb, which the pipeline's best-so-far forgives, and costs a fraction.

    Args:
        lengths: of the differences, by variable, in raw units (half-turns for angles).
        damping: λ.
        reach: no number of a row moves farther in a step than so many of its lengths.

    Raises:
        ValueError: for lengths that are not above 0, a damping below 0, a reach below 1, and, when a fit starts, names
            that differ from the generator's variables or a term that is descended and no sum of squares.
    """

    def __init__(self, lengths: dict[str, float], damping: float = 0.01, reach: float = 10.0) -> None:
        check_dict("GaussNewton: lengths", lengths, check_range, 1e-9)
        check_range("GaussNewton: damping", damping, 0)
        check_range("GaussNewton: reach", reach, 1)
        self.lengths, self.damping, self.reach = lengths, damping, reach

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        check_names("lengths", self.lengths, raw, complete=True)
        return {}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        rows, count = flatten(raw).shape
        lengths = flatten({name: torch.full_like(tensor[:1], self.lengths[name]) for name, tensor in raw.items()})[0]
        # The row itself, then with one of its numbers moved.
        moves = torch.cat([lengths.new_zeros(1, count), lengths.diag()])
        moved = evaluate.retract(repeated(raw, count + 1), unflatten(moves.repeat(rows, 1), raw))
        evaluation = evaluate(moved, problem.repeat_interleave(count + 1), need="residuals")
        residuals = evaluation.residuals.view(rows, count + 1, -1)
        jacobian = residuals[:, 1:] - residuals[:, :1]  # in lengths, which scale the numbers alike
        squares, slopes = jacobian @ jacobian.mT, (jacobian @ residuals[:, 0, :, None])[..., 0]
        diagonal = squares.diagonal(dim1=1, dim2=2)
        # Numbers that change nothing stay where they are, and do not make the matrix singular.
        damped = self.damping * diagonal + 1e-6 * diagonal.amax(1, keepdim=True).clamp_min(1e-30)
        delta, _ = torch.linalg.solve_ex(squares + torch.diag_embed(damped), -slopes)
        step = lengths * delta.clamp(-self.reach, self.reach)
        here = torch.arange(rows, device=step.device) * (count + 1)
        return evaluate.retract(raw, unflatten(step, raw)), _at(evaluation, here), memory


def _at(evaluation: Evaluation, rows: Tensor) -> Evaluation:
    """The evaluation of some rows."""
    parts = {name: part for name, part in vars(evaluation).items() if name != "rendering"}
    taken = pytree.tree_map_only(Tensor, lambda tensor: tensor[rows], parts)
    drawn = evaluation.rendering
    if drawn is not None:
        pictures = pictures_of(rows, len(drawn.image) // len(evaluation.energy))
        drawn = drawn.map(lambda tensor: tensor[pictures])
    return replace(evaluation, **taken, rendering=drawn)
