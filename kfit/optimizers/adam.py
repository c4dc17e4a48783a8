"""Adam with a learning rate for each variable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_dict, check_names, check_positive, check_range
from kfit.core.rows import broadcast_rows

BETAS = (0, 1 - 1e-9)
"""Range of the decays of the averages, which are below 1."""


class Adam(Optimizer):
    """Adam (Kingma and Ba 2015, algorithm 1), for each row independently.

    m ← β₁m + (1−β₁)g, v ← β₂v + (1−β₂)g², raw ← raw − rate · m̂ / (√v̂ + 1e-8). `torch.optim.Adam` computes the same
    numbers, but its state cannot lose rows. At step t = 0, 1, … of a row the rates are multiplied by decay^t.

    Args:
        rates: one rate for all variables, or one for each, in raw units a step (half-turns for angles); 0 holds it.
        betas: decay of the two averages; the released code fits with (0.5, 0.999).
        decay: factor of the rates from step to step, in (0, 1].

    Raises:
        ValueError: if a rate is below 0 (or the single rate is 0), a beta is outside [0, 1), the decay is outside (0,
            1] or, when a fit starts, the names differ from the generator's variables.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import Adam
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, Adam(0.02), num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(
        self,
        rates: float | dict[str, float] = 0.01,
        betas: tuple[float, float] = (0.5, 0.999),
        decay: float = 1.0,
    ) -> None:
        if isinstance(rates, dict):
            check_dict("Adam: rates", rates, check_range, 0)  # 0 holds a variable
        else:
            check_positive("Adam: rates", rates)
        check_arguments(Adam, locals(), betas=BETAS, decay=(1e-6, 1))
        self.rates, self.betas, self.decay = rates, betas, decay

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        if isinstance(self.rates, dict):
            check_names("rates", self.rates, raw, complete=True)
        return moments(raw)

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="gradient")
        rates = self.rates if isinstance(self.rates, dict) else dict.fromkeys(raw, self.rates)
        share = self.decay ** memory["count"]
        fallen = {name: rate * share for name, rate in rates.items()}
        step, memory = adam_step(evaluation.gradient, memory, fallen, self.betas)
        return evaluate.retract(raw, step), evaluation, memory


def moments(raw: Variables) -> dict[str, Any]:
    """Return Adam's memory before the first step."""
    first = next(iter(raw.values()))
    zeros = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
    # The count is kept for each row so that it survives pruning with the rest.
    return {"mean": zeros, "square": dict(zeros), "count": first.new_zeros(len(first))}


def adam_step(
    gradient: Variables,
    memory: dict[str, Any],
    rates: Mapping[str, float | Tensor],
    betas: tuple[float, float],
) -> tuple[Variables, dict[str, Any]]:
    """Compute one step of Adam.

    Args:
        gradient: (N, \\*raw_shape) each.
        memory: from `moments` or from the previous step.
        rates: by variable; a tensor holds a rate for each row, (N,).
        betas: decay of the two averages.

    Returns:
        The step (N, \\*raw_shape) of each variable, and the new memory.
    """
    low, high = betas
    count = memory["count"] + 1
    mean = {k: low * memory["mean"][k] + (1 - low) * g for k, g in gradient.items()}
    square = {k: high * memory["square"][k] + (1 - high) * g.square() for k, g in gradient.items()}
    step = {}
    for name, slope in gradient.items():
        rows, rate = broadcast_rows(count, slope), rates[name]
        unit = (mean[name] / (1 - low**rows)) / ((square[name] / (1 - high**rows)).sqrt() + 1e-8)
        step[name] = -(broadcast_rows(rate, slope) if isinstance(rate, Tensor) else rate) * unit
    return step, {"mean": mean, "square": square, "count": count}
