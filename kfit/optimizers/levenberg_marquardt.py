"""Levenberg–Marquardt for many rows at once."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.check import check_count, check_positive
from kfit.optimizers.flat import flatten, unflatten

# Rows drawn at once for the Jacobian: bounds the memory that features and residuals take.
ROWS_AT_ONCE = 256


class LevenbergMarquardt(Optimizer):
    """Damped Gauss–Newton for energies that are sums of squares, each row with a damping of its own.

    δ solves (JᵀJ + λ·diag JᵀJ) δ = −Jᵀr (Marquardt 1963). A step that lowers the energy is taken and λ falls by its
    gain ρ, λ ← λ · max(1/3, 1 − (2ρ − 1)³); otherwise λ ← λν, ν ← 2ν and the row tries again (Nielsen 1999). So the
    energy of a row never rises while the weights stay.

    J, which only shapes the step, is taken by forward differences, one picture for each of the P numbers of a row:
    ``grid_sample`` has no forward-mode derivative, and two backward passes for each cost several times as much. The
    slope Jᵀr, which decides where the fit ends, is half the exact gradient. A step draws 2 + P + trials pictures a row.

    Args:
        damping: λ at the start, relative to the diagonal.
        max_trials: dampings tried in a step.

    Raises:
        ValueError: for a damping that is not above 0 or no trials, and, in a fit, where a term that is descended is no
            sum of squares.
    """

    def __init__(self, damping: float = 1e-2, max_trials: int = 4) -> None:
        check_positive("LevenbergMarquardt: damping", damping)
        check_count("LevenbergMarquardt: max_trials", max_trials)
        self.damping, self.max_trials = damping, max_trials

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        place = flatten(raw)
        return {"damping": place.new_full((len(place),), self.damping), "growth": place.new_full((len(place),), 2.0)}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        seen = evaluate(raw, problem, need="gradient")
        assert seen.gradient is not None  # asked for one line above
        place, energy, slopes = flatten(raw), seen.energy, flatten(seen.gradient) / 2
        squares = _squares(evaluate, raw, problem)
        diagonal = squares.diagonal(dim1=1, dim2=2)
        # Numbers that change nothing stay where they are, and do not make the matrix singular.
        diagonal = diagonal.clamp_min(1e-30).maximum(1e-6 * diagonal.amax(1, keepdim=True))
        found, damping, growth = place, memory["damping"], memory["growth"]
        pending = torch.ones_like(problem, dtype=torch.bool)
        for _ in range(self.max_trials):
            rows = pending.nonzero()[:, 0]
            if len(rows) == 0:
                break
            scaled = damping[rows, None] * diagonal[rows]
            delta, _ = torch.linalg.solve_ex(squares[rows] + torch.diag_embed(scaled), -slopes[rows])
            tried = place[rows] + delta
            fall = (energy[rows] - evaluate(unflatten(tried, raw), problem[rows]).energy).to(delta)
            fell = fall > 0
            ratio = fall / (delta * (scaled * delta - slopes[rows])).sum(1).clamp_min(1e-30)
            calmer = damping[rows] * (1 - (2 * ratio.clamp(0, 1) - 1) ** 3).clamp_min(1 / 3)
            stronger = damping[rows] * growth[rows]
            found = found.index_copy(0, rows, torch.where(fell[:, None], tried, found[rows]))
            damping = damping.index_copy(0, rows, torch.where(fell, calmer, stronger).clamp(1e-9, 1e9))
            growth = growth.index_copy(0, rows, torch.where(fell, 2.0, (2 * growth[rows]).clamp_max(1e3)))
            pending = pending.index_copy(0, rows, ~fell)
        return unflatten(found, raw), seen, {"damping": damping, "growth": growth}


def _squares(evaluate: Evaluate, raw: Variables, problem: Tensor) -> Tensor:
    """JᵀJ (N, P, P), by forward differences in raw units."""
    place = flatten(raw)
    rows, count = place.shape
    length = torch.finfo(place.dtype).eps ** 0.5
    shifts = length * torch.eye(count + 1, count, dtype=place.dtype, device=place.device)  # the last is none
    found = []
    for piece in torch.arange(rows, device=place.device).split(max(1, ROWS_AT_ONCE // (count + 1))):
        moved = unflatten((place[piece, None] + shifts).flatten(0, 1), raw)
        residuals = evaluate(moved, problem[piece].repeat_interleave(count + 1), need="residuals").residuals
        assert residuals is not None  # asked for one line above
        residuals = residuals.view(len(piece), count + 1, -1)
        jacobian = (residuals[:, :-1] - residuals[:, -1:]) / length
        found.append((jacobian @ jacobian.mT).to(place))
    return torch.cat(found)
