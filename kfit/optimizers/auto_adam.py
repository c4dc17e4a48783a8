"""Adam with learning rates measured from how much each variable changes the picture."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, GradientEvaluation, Optimizer, Rendering, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.optimizers.adam import BETAS, adam_step, moments
from kfit.optimizers.random import normal


class AutoAdam(Optimizer):
    """`Adam` with a rate for each variable and row, chosen such that each variable's step changes the picture equally.

    rate_v = change / s_v, where s_v is the root mean square difference that a small step of all numbers of the variable
    at once, with random signs, makes to the picture, divided by the step's length; at most 1 raw unit a step. It is
    measured once, at a row's first step, with one additional picture for each variable.

    The idea is SimpleITK's ``SetOptimizerScalesFromPhysicalShift``, with the picture's change in place of the points'
    shift, because not every variable moves points.

    Args:
        change: root mean square change of the picture by each variable's step, in picture units.
        betas: decay of Adam's two averages.

    Raises:
        ValueError: if ``change`` is not above 0, or a beta is outside [0, 1).

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import AutoAdam
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, AutoAdam(), num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, change: float = 0.01, betas: tuple[float, float] = (0.5, 0.999)) -> None:
        check_arguments(AutoAdam, locals(), change=(check_positive,), betas=BETAS)
        self.change, self.betas = change, betas

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        unknown = {name: tensor.new_full((len(tensor),), torch.nan) for name, tensor in raw.items()}
        return {"moments": moments(raw), "seed": seeds, "rates": unknown, "measured": torch.zeros_like(seeds).bool()}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="gradient")
        rates = memory["rates"]
        if not bool(memory["measured"].all()):
            rates = self._rates(evaluate, raw, problem, evaluation, memory["seed"])
        step, held = adam_step(evaluation.gradient, memory["moments"], rates, self.betas)
        measured = torch.ones_like(memory["measured"])
        return (
            evaluate.retract(raw, step),
            evaluation,
            {"moments": held, "seed": memory["seed"], "rates": rates, "measured": measured},
        )

    def _rates(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, evaluation: GradientEvaluation, seeds: Tensor
    ) -> dict[str, Tensor]:
        before, rates = _picture(evaluation.rendering), {}
        length = torch.finfo(before.dtype).eps ** (1 / 3)
        for number, (name, tensor) in enumerate(raw.items()):
            signs = normal(seeds + number, tensor.shape[1:], tensor).sign()
            moved = evaluate.retract({name: tensor}, {name: length * signs})
            after = _picture(evaluate({**raw, **moved}, problem).rendering)
            sensitivity = (after - before).reshape(len(problem), -1).square().mean(1).sqrt() / length
            rates[name] = self.change / sensitivity.to(tensor).clamp_min(self.change)
        return rates


def _picture(rendering: Rendering | None) -> Tensor:
    if rendering is None:
        raise ValueError("AutoAdam measures how the picture changes, and this evaluation has none")
    return rendering.image
