"""Levenberg–Marquardt for many rows at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Linearization, Optimizer, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.optimizers.flat import flatten, repeated, unflatten
from kfit.optimizers.random import normal

# Rows drawn at once for the Jacobian: bounds the memory that features and residuals take.
ROWS_AT_ONCE = 256
# Rows of more numbers than this are solved by products with the Jacobian, without storing it.
MAX_DIFFERENCES = 64
# Of conjugate gradients: probes of the diagonal, iterations, and relative tolerance.
NUM_PROBES, MAX_ITERATIONS, TOLERANCE = 8, 50, 0.03


class LevenbergMarquardt(Optimizer):
    """Damped Gauss–Newton for energies that are sums of squares, each row with its own damping.

    δ solves (JᵀJ + λ·diag JᵀJ) δ = −Jᵀr (Marquardt 1963). A step that lowers the energy is taken and λ decreases by its
    gain ρ, λ ← λ · max(1/3, 1 − (2ρ − 1)³); otherwise λ ← λν, ν ← 2ν and the row tries again (Nielsen 1999). The energy
    of a row therefore never rises while the weights are constant. The slope Jᵀr, which decides where the fit ends, is
    half of the exact gradient.

    For up to 64 numbers a row, J, which only shapes the step, is computed by forward differences: a step draws
    2 + P + trials pictures a row. For more, δ is found by conjugate gradients from products Jv and Jᵀu, each a backward
    pass through one drawing (`kfit.core.Linearization`; Nocedal and Wright 2006, algorithm 7.1): a step draws
    2 + trials pictures and makes some 20 to 200 passes, whatever the number of unknowns, and the generator and the
    energies must be twice differentiable. The diagonal is then estimated as the mean of (Jᵀz)² over 8 random vectors z
    of ±1.

    Args:
        damping: initial λ, relative to the diagonal.
        max_trials: number of dampings tried in a step.

    Raises:
        ValueError: if ``damping`` is not above 0, ``max_trials`` is below 1 or, in a fit, a descended term is not a sum
            of squares.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import LevenbergMarquardt
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> optimizer = LevenbergMarquardt()
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, optimizer, num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, damping: float = 1e-2, max_trials: int = 4) -> None:
        check_arguments(LevenbergMarquardt, locals(), damping=(check_positive,))
        self.damping, self.max_trials = damping, max_trials

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        place = flatten(raw)
        damping, growth = (place.new_full((len(place),), value) for value in (self.damping, 2.0))
        return {"damping": damping, "growth": growth, "seed": seeds}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="gradient")
        energy, slopes = evaluation.energy, flatten(evaluation.gradient) / 2
        solve, diagonal = self._model(evaluate, raw, problem, slopes, memory["seed"])
        found, damping, growth = torch.zeros_like(slopes), memory["damping"], memory["growth"]
        pending = torch.ones_like(problem, dtype=torch.bool)
        for _ in range(self.max_trials):
            rows = pending.nonzero()[:, 0]
            if len(rows) == 0:
                break
            delta = solve(damping[:, None] * diagonal, rows)
            scaled = damping[rows, None] * diagonal[rows]
            tried = evaluate.retract({name: tensor[rows] for name, tensor in raw.items()}, unflatten(delta, raw))
            fall = (energy[rows] - evaluate(tried, problem[rows]).energy).to(delta)
            fell = fall > 0
            ratio = fall / (delta * (scaled * delta - slopes[rows])).sum(1).clamp_min(1e-30)
            calmer = damping[rows] * (1 - (2 * ratio.clamp(0, 1) - 1) ** 3).clamp_min(1 / 3)
            stronger = damping[rows] * growth[rows]
            found = found.index_copy(0, rows, torch.where(fell[:, None], delta, found[rows]))
            damping = damping.index_copy(0, rows, torch.where(fell, calmer, stronger).clamp(1e-9, 1e9))
            growth = growth.index_copy(0, rows, torch.where(fell, 2.0, (2 * growth[rows]).clamp_max(1e3)))
            pending = pending.index_copy(0, rows, ~fell)
        memory = {"damping": damping, "growth": growth, "seed": memory["seed"]}
        return evaluate.retract(raw, unflatten(found, raw)), evaluation, memory

    @staticmethod
    def _model(
        evaluate: Evaluate, raw: Variables, problem: Tensor, slopes: Tensor, seeds: Tensor
    ) -> tuple[Callable[[Tensor, Tensor], Tensor], Tensor]:
        """Return a solver for δ of some rows, given λ·diag JᵀJ of all, and diag JᵀJ (N, P)."""
        if slopes.shape[1] > MAX_DIFFERENCES:
            linear = evaluate.linearize(raw, problem)
            diagonal = _kept_above_zero(_diagonal(linear, slopes, seeds))
            return lambda damped, rows: _conjugate_gradients(linear, damped, diagonal, slopes, rows), diagonal
        squares = _squares(evaluate, raw, problem)
        diagonal = _kept_above_zero(squares.diagonal(dim1=1, dim2=2))

        def solve(damped: Tensor, rows: Tensor) -> Tensor:
            delta: Tensor = torch.linalg.solve_ex(squares[rows] + torch.diag_embed(damped[rows]), -slopes[rows])[0]
            return delta

        return solve, diagonal


def _kept_above_zero(diagonal: Tensor) -> Tensor:
    """Clamp a diagonal, so that numbers without effect stay unchanged and the matrix is not singular."""
    return diagonal.clamp_min(1e-30).maximum(1e-6 * diagonal.amax(1, keepdim=True))


def _squares(evaluate: Evaluate, raw: Variables, problem: Tensor) -> Tensor:
    """Compute JᵀJ (N, P, P) by forward differences in raw units."""
    place = flatten(raw)
    rows, count = place.shape
    length = torch.finfo(place.dtype).eps ** 0.5
    shifts = length * torch.eye(count + 1, count, dtype=place.dtype, device=place.device)  # the last is 0
    found = []
    for piece in torch.arange(rows, device=place.device).split(max(1, ROWS_AT_ONCE // (count + 1))):
        here = repeated({name: tensor[piece] for name, tensor in raw.items()}, count + 1)
        moved = evaluate.retract(here, unflatten(shifts.repeat(len(piece), 1), raw))
        residuals = evaluate(moved, problem[piece].repeat_interleave(count + 1), need="residuals").residuals
        residuals = residuals.view(len(piece), count + 1, -1)
        jacobian = (residuals[:, :-1] - residuals[:, -1:]) / length
        found.append((jacobian @ jacobian.mT).to(place))
    return torch.cat(found)


def _diagonal(linear: Linearization, slopes: Tensor, seeds: Tensor) -> Tensor:
    """Estimate diag JᵀJ (N, P) without bias: E[(Jᵀz)²] over random signs z."""
    like = linear.push(torch.zeros_like(slopes))
    probes = (normal(seeds + number, like.shape[1:], like).sign() for number in range(NUM_PROBES))
    return torch.stack([linear.pull(probe).square() for probe in probes]).mean(0)


def _conjugate_gradients(
    linear: Linearization, damped: Tensor, diagonal: Tensor, slopes: Tensor, rows: Tensor
) -> Tensor:
    """Solve (JᵀJ + damped) δ = −slopes for some rows, preconditioned by the diagonal; each row ends independently."""
    scale = diagonal + damped
    delta, residual = torch.zeros_like(slopes), -slopes
    toward = residual / scale
    direction, product = toward, (residual * toward).sum(1)
    goal = TOLERANCE**2 * product
    active = torch.zeros_like(product, dtype=torch.bool).index_fill(0, rows, True) & (product > 0)
    for _ in range(MAX_ITERATIONS):
        if not bool(active.any()):
            break
        image = linear.pull(linear.push(direction)) + damped * direction
        curvature = (direction * image).sum(1)
        active = active & (curvature > 0)  # false where a row is not finite
        length = torch.where(active, product / curvature.where(active, 1.0), 0.0)[:, None]
        # Not `length * direction` alone: 0 · ∞ is NaN in a row that is not finite.
        delta = torch.where(active[:, None], delta + length * direction, delta)
        residual = torch.where(active[:, None], residual - length * image, residual)
        toward = residual / scale
        after = (residual * toward).sum(1)
        direction = torch.where(
            active[:, None], toward + (after / product.where(active, 1.0))[:, None] * direction, 0.0
        )
        product = torch.where(active, after, product)
        active = active & (product > goal)
    return delta[rows]
