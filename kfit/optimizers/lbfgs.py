"""Limited-memory BFGS for many rows at once."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.optimizers.flat import flatten, unflatten

# Armijo's condition, E(x + t·d) ≤ E(x) + c·t·gᵀd (Nocedal and Wright, section 3.1).
SUFFICIENT = 1e-4


class LBFGS(Optimizer):
    """Limited-memory BFGS with backtracking, for each row independently.

    By Nocedal and Wright 2006, algorithms 7.4 and 3.1. A step draws each row once with a gradient, then once for each
    trial length along its direction, until the energy satisfies Armijo's condition. A row for which no length does
    stays unchanged and forgets its curvature. The energy of a row therefore never rises while the weights are constant.
    `torch.optim.LBFGS` treats all rows as one vector.

    Args:
        history: number of pairs of steps and gradient changes that are kept.
        first_step: largest change of any raw number in a step without known curvature.
        max_trials: lengths tried in a step; each is 0.1 to 0.5 × the previous one, at the minimum of a parabola.

    Raises:
        ValueError: if ``history`` or ``max_trials`` is below 1, or ``first_step`` is not above 0.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import LBFGS
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, LBFGS(), num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, history: int = 10, first_step: float = 0.03, max_trials: int = 8) -> None:
        check_arguments(LBFGS, locals(), first_step=(check_positive,))
        self.history, self.first_step, self.max_trials = history, first_step, max_trials

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        place = flatten(raw)
        pairs = place.new_zeros(len(place), self.history, place.shape[1])
        return {"move": torch.zeros_like(place), "gradient": torch.zeros_like(place), "moves": pairs, "bends": pairs}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="gradient")
        gradient = flatten(evaluation.gradient)
        moves, bends = self._remembered(memory["move"], gradient - memory["gradient"], memory)
        direction = self._direction(gradient, moves, bends)
        move, failed = self._search(evaluate, raw, problem, evaluation.energy, gradient, direction)
        forgets = failed[:, None, None]
        new = {
            "move": move,
            "gradient": gradient,
            "moves": moves.masked_fill(forgets, 0.0),
            "bends": bends.masked_fill(forgets, 0.0),
        }
        return evaluate.retract(raw, unflatten(move, raw)), evaluation, new

    @staticmethod
    def _remembered(move: Tensor, bend: Tensor, memory: Any) -> tuple[Tensor, Tensor]:
        """Append the last step to the histories of rows whose energy curved upwards along it."""
        curved = (move * bend).sum(1) > 1e-8 * move.norm(dim=1) * bend.norm(dim=1)
        pairs = []
        for name, last in (("moves", move), ("bends", bend)):
            longer = torch.cat([memory[name][:, 1:], last[:, None]], 1)
            pairs.append(torch.where(curved[:, None, None], longer, memory[name]))
        return pairs[0], pairs[1]

    def _direction(self, gradient: Tensor, moves: Tensor, bends: Tensor) -> Tensor:
        curvature = (moves * bends).sum(2)  # (N, history), 0 where a row holds no pair
        inverse = torch.where(curvature > 0, 1 / curvature.clamp_min(torch.finfo(gradient.dtype).tiny), 0.0)
        direction, shares = -gradient, []
        for k in reversed(range(self.history)):
            share = inverse[:, k, None] * (moves[:, k] * direction).sum(1, keepdim=True)
            direction = direction - share * bends[:, k]
            shares.append(share)
        first = self.first_step / gradient.abs().amax(1).clamp_min(1e-30)
        known = curvature[:, -1] > 0
        size = torch.where(known, curvature[:, -1] / bends[:, -1].square().sum(1).where(known, 1.0), first)
        direction = size[:, None] * direction
        for k, share in zip(range(self.history), reversed(shares), strict=True):
            back = inverse[:, k, None] * (bends[:, k] * direction).sum(1, keepdim=True)
            direction = direction + moves[:, k] * (share - back)
        return direction

    def _search(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, energy: Tensor, gradient: Tensor, direction: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the step of each row, and whether no trial length was accepted."""
        slope = (gradient * direction).sum(1)
        # Decreases below rounding error are not worth a picture.
        worth = ~(-slope <= torch.finfo(energy.dtype).eps * energy.abs())
        found, there = torch.zeros_like(direction), ~worth
        length = torch.ones_like(slope)
        for _ in range(self.max_trials):
            rows = (~there).nonzero()[:, 0]
            if len(rows) == 0:
                break
            t, down, before = length[rows], slope[rows], energy[rows].to(slope)
            tried = t[:, None] * direction[rows]
            moved = evaluate.retract({k: v[rows] for k, v in raw.items()}, unflatten(tried, raw))
            after = evaluate(moved, problem[rows]).energy.to(slope)
            fell = (after <= before + SUFFICIENT * t * down) & (after < before)
            found = found.index_copy(0, rows, torch.where(fell[:, None], tried, found[rows]))
            there = there.index_copy(0, rows, fell)
            parabola = -down * t.square() / (2 * (after - before - down * t))
            shorter = torch.where(parabola.isfinite(), parabola, 0.0)
            length = length.index_copy(0, rows, torch.minimum(torch.maximum(shorter, 0.1 * t), 0.5 * t))
        return found, ~there
