"""Gauss–Newton by finite differences, for few variables near their answer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_names
from kfit.core.rows import pictures_of
from kfit.optimizers.flat import flatten, repeated, unflatten


class GaussNewton(Optimizer):
    """Gauss–Newton with finite differences, without gradients, for energies that are sums of squares.

    δ solves (JᵀJ + λ·diag JᵀJ) δ = −Jᵀr, with the Jacobian J of the residuals r by forward differences, one picture for
    each of the P numbers of a row: a step draws 1 + P pictures a row. Differences about as long as the expected steps
    smooth over roughness at smaller scales. Steps are not tested: unlike `kfit.optimizers.LevenbergMarquardt` it may
    increase the energy, which the pipeline's best-so-far tolerates, and it costs a fraction.

    Args:
        lengths: lengths of the differences, by variable, in raw units (half-turns for angles).
        damping: λ.
        reach: limit of each number's step, as a multiple of its length.

    Raises:
        ValueError: if a length is not above 0, the damping is below 0, the reach is below 1 or, when a fit starts, the
            names differ from the generator's variables or a descended term is not a sum of squares.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import GaussNewton
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> optimizer = GaussNewton({"shift": 0.02})
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, optimizer, num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, lengths: dict[str, float], damping: float = 0.01, reach: float = 10.0) -> None:
        check_arguments(GaussNewton, locals(), lengths=(1e-9,), damping=(0,), reach=(1,))
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
        jacobian = residuals[:, 1:] - residuals[:, :1]  # in units of the lengths, which scale the numbers alike
        squares, slopes = jacobian @ jacobian.mT, (jacobian @ residuals[:, 0, :, None])[..., 0]
        diagonal = squares.diagonal(dim1=1, dim2=2)
        # Numbers without effect on the residuals stay unchanged, and do not make the matrix singular.
        damped = self.damping * diagonal + 1e-6 * diagonal.amax(1, keepdim=True).clamp_min(1e-30)
        delta, _ = torch.linalg.solve_ex(squares + torch.diag_embed(damped), -slopes)
        step = lengths * delta.clamp(-self.reach, self.reach)
        here = torch.arange(rows, device=step.device) * (count + 1)
        return evaluate.retract(raw, unflatten(step, raw)), _at(evaluation, here), memory


def _at(evaluation: Evaluation, rows: Tensor) -> Evaluation:
    """Return the evaluation of some rows."""
    parts = {name: part for name, part in vars(evaluation).items() if name != "rendering"}
    taken = pytree.tree_map_only(Tensor, lambda tensor: tensor[rows], parts)
    drawn = evaluation.rendering
    if drawn is not None:
        pictures = pictures_of(rows, len(drawn.image) // len(evaluation.energy))
        drawn = drawn.map(lambda tensor: tensor[pictures])
    return replace(evaluation, **taken, rendering=drawn)
