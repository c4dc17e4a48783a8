"""CMA-ES: a normal distribution for each row that adapts without gradients."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_dict, check_names, check_positive
from kfit.optimizers.flat import flatten, repeated, unflatten
from kfit.optimizers.random import normal


class CMAES(Optimizer):
    """Covariance matrix adaptation (Hansen, The CMA evolution strategy: a tutorial, 2016, with μ positive weights).

    Each row is the mean of its own normal distribution. A step draws a population around it, moves the mean to the
    weighted best half, and adapts covariance and step size. It needs energies alone, so it works with any generator,
    one exported to ONNX as well. A step draws 1 + population pictures a row. The random numbers of a row come from its
    seed.

    Args:
        sigma: initial standard deviation in raw units, one for all variables or one for each.
        population: pictures a step and row; by default 4 + ⌊3 ln P⌋ for P numbers.

    Raises:
        ValueError: if a sigma is not above 0, the population is below 4 or, when a fit starts, the names differ from
            the generator's variables.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import CMAES
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, CMAES(), num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(self, sigma: float | dict[str, float] = 0.1, population: int | None = None) -> None:
        if isinstance(sigma, dict):
            check_dict("CMAES: sigma", sigma, check_positive)
        else:
            check_positive("CMAES: sigma", sigma)
        check_arguments(CMAES, locals(), population=(4,))
        self.sigma, self.population = sigma, population

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        if isinstance(self.sigma, dict):
            check_names("sigma", self.sigma, raw, complete=True)
        sigma = self.sigma if isinstance(self.sigma, dict) else dict.fromkeys(raw, self.sigma)
        widths = flatten({name: torch.full_like(tensor, sigma[name]) for name, tensor in raw.items()})
        zeros = torch.zeros_like(widths)
        return {
            "covariance": torch.diag_embed(widths.square()),
            "size": torch.ones_like(widths[:, 0]),
            "path": zeros,
            "size_path": zeros,
            "seed": seeds,
            "count": torch.zeros_like(seeds),
        }

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem)
        mean = flatten(raw)
        rows, dim = mean.shape
        population = self.population or 4 + math.floor(3 * math.log(dim))
        # A row that is NaN must not break the decomposition of the others.
        fine = memory["covariance"].isfinite().flatten(1).all(1)[:, None, None]
        eye = torch.eye(dim, dtype=mean.dtype, device=mean.device)
        spectrum, axes = torch.linalg.eigh(torch.where(fine, memory["covariance"], eye))
        deviations = spectrum.clamp_min(1e-20).sqrt()
        drawn = normal(memory["seed"] + memory["count"], (population, dim), mean)
        steps = (drawn * deviations[:, None]) @ axes.mT  # (N, population, P)
        moves = (memory["size"][:, None, None] * steps).flatten(0, 1)
        tried = evaluate.retract(repeated(raw, population), unflatten(moves, raw))
        energy = evaluate(tried, problem.repeat_interleave(population)).energy
        energy = torch.where(energy.isfinite(), energy, torch.inf).view(rows, population)
        best = energy.argsort(dim=1, stable=True)[:, : population // 2]
        chosen = steps.gather(1, best[..., None].expand(-1, -1, dim))
        step, memory = self._adapted(chosen, (deviations, axes), population, memory)
        return evaluate.retract(raw, unflatten(step, raw)), evaluation, memory

    @staticmethod
    def _adapted(chosen: Tensor, roots: tuple[Tensor, Tensor], population: int, memory: Any) -> tuple[Tensor, Any]:
        """Return the step of the mean and the new memory; the constants are the tutorial's (table 1)."""
        parents, dim = chosen.shape[1:]
        weights = math.log((population + 1) / 2) - torch.arange(1, parents + 1).to(chosen).log()
        weights = weights / weights.sum()
        mass = float(1 / weights.square().sum())
        size_rate = (mass + 2) / (dim + mass + 5)
        size_damp = 1 + 2 * max(0.0, math.sqrt((mass - 1) / (dim + 1)) - 1) + size_rate
        path_rate = (4 + mass / dim) / (dim + 4 + 2 * mass / dim)
        one_rate = 2 / ((dim + 1.3) ** 2 + mass)
        many_rate = min(1 - one_rate, 2 * (mass - 2 + 1 / mass) / ((dim + 2) ** 2 + mass))
        expected = math.sqrt(dim) * (1 - 1 / (4 * dim) + 1 / (21 * dim**2))

        move = (weights[:, None] * chosen).sum(1)
        deviations, axes = roots
        whitened = (((move[:, None] @ axes) / deviations[:, None]) @ axes.mT)[:, 0]
        size_path = (1 - size_rate) * memory["size_path"] + math.sqrt(size_rate * (2 - size_rate) * mass) * whitened
        count = memory["count"] + 1
        norm = size_path.norm(dim=1)
        settled = (1 - (1 - size_rate) ** (2 * count.to(chosen))).sqrt()
        slow = norm / settled < (1.4 + 2 / (dim + 1)) * expected
        gain = math.sqrt(path_rate * (2 - path_rate) * mass)
        path = (1 - path_rate) * memory["path"] + gain * slow[:, None] * move
        stalled = (~slow).to(chosen) * path_rate * (2 - path_rate)
        many = torch.einsum("k,nki,nkj->nij", weights, chosen, chosen)
        keep = 1 - one_rate - many_rate + one_rate * stalled
        covariance = keep[:, None, None] * memory["covariance"] + many_rate * many
        covariance = covariance + one_rate * path[:, :, None] * path[:, None]
        # A factor of 10 in one step is more than any fit needs, and bounds the step size where the energy is flat.
        size = memory["size"] * ((size_rate / size_damp) * (norm / expected - 1)).clamp(-2.3, 2.3).exp()
        held = {"covariance": covariance, "size": size, "path": path, "size_path": size_path}
        return memory["size"][:, None] * move, {**held, "seed": memory["seed"], "count": count}
