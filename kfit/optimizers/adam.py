"""Adam with a rate for each variable."""

from __future__ import annotations

from typing import Any

import torch

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.check import check_names, check_range


class Adam(Optimizer):
    """Kingma and Ba's Adam (2015, algorithm 1), each row on its own.

    m ← β₁m + (1−β₁)g, v ← β₂v + (1−β₂)g², raw ← raw − rate · m̂ / (√v̂ + 1e-8). `torch.optim.Adam` computes the same
    numbers, but its state cannot lose rows.

    Args:
        rates: one rate for all, or one for each variable, in raw units a step (half-turns for angles).
        betas: decay of the two averages; the released code fits with (0.5, 0.999).

    Raises:
        ValueError: for rates that are not above zero, betas outside [0, 1), or, when a fit starts, names that differ
            from the generator's variables.
    """

    def __init__(self, rates: float | dict[str, float] = 0.01, betas: tuple[float, float] = (0.5, 0.999)) -> None:
        for name, rate in rates.items() if isinstance(rates, dict) else [("rates", rates)]:
            if not rate > 0:
                raise ValueError(f"Adam: rates must be above 0, got {rate!r} for {name}")
        for beta in betas:
            check_range("Adam: betas", beta, 0.0, 1 - 1e-9)
        self.rates, self.betas = rates, betas

    def init(self, raw: Variables) -> Any:
        if isinstance(self.rates, dict):
            check_names("rates", self.rates, raw, complete=True)
        first = next(iter(raw.values()))
        zeros = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
        # The count is kept for each row so that it survives pruning with the rest.
        return {"mean": zeros, "square": dict(zeros), "count": first.new_zeros(len(first))}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: torch.Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        seen = evaluate(raw, problem, need="gradient")
        assert seen.gradient is not None  # asked for one line above
        low, high = self.betas
        count = memory["count"] + 1
        mean = {k: low * memory["mean"][k] + (1 - low) * g for k, g in seen.gradient.items()}
        square = {k: high * memory["square"][k] + (1 - high) * g.square() for k, g in seen.gradient.items()}
        new = {}
        for name, tensor in raw.items():
            rows = count.view(-1, *[1] * (tensor.dim() - 1))
            rate = self.rates[name] if isinstance(self.rates, dict) else self.rates
            step = (mean[name] / (1 - low**rows)) / ((square[name] / (1 - high**rows)).sqrt() + 1e-8)
            new[name] = tensor - rate * step
        return new, seen, {"mean": mean, "square": square, "count": count}
