"""What a pipeline's optimizer asks: how good are these rows, and which way is down?"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core import (
    Energy,
    Evaluation,
    Generator,
    Observation,
    Prior,
    Rendering,
    ResidualEnergy,
    ResidualPrior,
    Variables,
)
from kfit.core.contracts import Need
from kfit.jacobian import JacobianProducts

# Pixels that are drawn at once. On a CPU what a chunk of 16 pictures of 64 × 64 needs stays in the cache and is memory
# that is used again: 120 at once take 1.7 times as long a picture, and 2 as long again as 16.
CHUNK_PIXELS = {"cpu": 16 * 64 * 64}
CHUNK_PIXELS_ELSEWHERE = 512 * 64 * 64


class Judge:
    """The `kfit.core.Evaluate` of one fit: draws rows, compares them with targets whose features it holds.

    Rows are drawn in chunks, so that memory does not grow with their number; no row's answer depends on others. Under
    ``torch.autocast`` the generator draws in its precision, and of the terms those compare in it that say they can.

    Args:
        generator: frozen.
        terms: energies and priors by name, frozen.
        rank_weights: weights by which rows are ranked.
        observation: B problems.

    Attributes:
        weights: of the terms in the energy that is descended; the pipeline sets them before each step.
        num_evaluations: pictures drawn so far.
    """

    def __init__(
        self,
        generator: Generator,
        terms: Mapping[str, Energy | Prior],
        rank_weights: Mapping[str, float],
        observation: Observation,
    ) -> None:
        self.generator, self.terms, self.rank_weights = generator, terms, rank_weights
        self.spaces = {name: variable.space for name, variable in generator.variables.items()}
        self.weights: dict[str, float] = {}
        self.num_evaluations = 0
        self.device = observation.image.device.type
        self.prepared: dict[str, Any] = {}
        for name, term in self.terms.items():
            with self._precision(term):
                self.prepared[name] = (
                    term.prepare(observation.handed(term.on), observation.weight)
                    if isinstance(term, Energy)
                    else term.prepare(observation)
                )
        self._rows: tuple[Tensor, list[Any]] | None = None
        height, width = observation.image.shape[-2:]
        pixels = CHUNK_PIXELS.get(observation.image.device.type, CHUNK_PIXELS_ELSEWHERE)
        self.chunk = max(1, pixels // (height * width))

    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Draw and compare.

        Raises:
            ValueError: if residuals are asked for and a term that is descended is no sum of squares.
        """
        self.num_evaluations += len(problem)
        prepared = self._gather(problem)
        chunks = [
            self._evaluate({name: tensor[rows] for name, tensor in raw.items()}, prepared[number], need)
            for number, rows in enumerate(self._chunks(len(problem)))
        ]
        joined: Evaluation = _joined(chunks)
        return joined

    def retract(self, raw: Variables, step: Variables) -> Variables:
        """Raw variables after a step, each in its own space."""
        return {name: self.spaces[name].retract(tensor.detach(), step[name]) for name, tensor in raw.items()}

    def linearize(self, raw: Variables, problem: Tensor) -> JacobianProducts:
        """Draw rows once and keep their graphs, for products with the Jacobian of their residuals.

        Raises:
            ValueError: if a term that is descended is no sum of squares.
        """
        self.num_evaluations += len(problem)
        prepared, parts = self._gather(problem), []
        for number, rows in enumerate(self._chunks(len(problem))):
            part = {name: tensor[rows] for name, tensor in raw.items()}
            with torch.enable_grad():
                steps = {name: torch.zeros_like(tensor, requires_grad=True) for name, tensor in part.items()}
                drawn = self._draw(self.retract(part, steps), prepared[number], "residuals")
                parts.append((list(steps.values()), torch.cat(drawn.residuals, 1)))
        return JacobianProducts(parts)

    def _evaluate(self, raw: Variables, prepared: Any, need: Need) -> Evaluation:
        wants = need == "gradient"
        with torch.set_grad_enabled(wants):
            steps = {name: torch.zeros_like(tensor, requires_grad=wants) for name, tensor in raw.items()}
            drawn = self._draw(self.retract(raw, steps) if wants else raw, prepared, need)
            energy = torch.stack([self.weights[name] * term for name, term in drawn.terms.items()]).sum(0)
            gradient = self._gradient(energy, steps) if wants else None
        ranked = [self.rank_weights.get(name, 0.0) * term.detach() for name, term in drawn.terms.items()]
        return Evaluation(
            energy=energy.detach(),
            ranking=torch.stack(ranked).sum(0),
            terms={name: term.detach() for name, term in drawn.terms.items()},
            values={name: value.detach() for name, value in drawn.values.items()},
            gradient=gradient,
            residuals=torch.cat(drawn.residuals, 1) if need == "residuals" else None,
            rendering=drawn.rendering.map(Tensor.detach),
        )

    def _draw(self, raw: Variables, prepared: Any, need: Need) -> _Drawn:
        """Draw rows and compare them, with a graph where gradients are enabled."""
        values = {name: self.spaces[name].to_value(tensor) for name, tensor in raw.items()}
        rendering: Rendering = self.generator(**values).map(_at_least_single)
        terms: dict[str, Tensor] = {}
        # None of them, where no term is descended.
        residuals = [rendering.image.new_zeros(len(rendering.image), 0)]
        for name, term in self.terms.items():
            weight = self.weights[name]
            if not weight and not self.rank_weights.get(name):
                continue
            handed = self._values(term, values) if isinstance(term, Prior) else rendering.handed(term.on)
            given = (handed,) if prepared[name] is None else (handed, prepared[name])
            if need == "residuals" and weight:
                with self._precision(term):
                    parts = self._residuals(name, given)
                residuals.append(weight**0.5 * parts)
                terms[name] = parts.square().sum(1)
                continue
            # What only ranks has no slope.
            with torch.set_grad_enabled(torch.is_grad_enabled() and bool(weight)), self._precision(term):
                terms[name] = term(*given) if isinstance(term, Prior) else term.compare(*given)
        return _Drawn(values, rendering, terms, residuals)

    def _precision(self, term: Energy | Prior) -> AbstractContextManager[Any]:
        """The precision around, for a term that can compare in it; else single."""
        mixed = isinstance(term, Energy) and term.mixed
        return nullcontext() if mixed else torch.autocast(self.device, enabled=False)

    @staticmethod
    def _values(prior: Prior, values: Variables) -> Any:
        return values[prior.on] if isinstance(prior.on, str) else {name: values[name] for name in prior.on}

    def _residuals(self, name: str, given: tuple[Any, ...]) -> Tensor:
        term = self.terms[name]
        if self.weights[name] < 0 or not isinstance(term, ResidualEnergy | ResidualPrior):
            squares = [n for n, t in self.terms.items() if isinstance(t, ResidualEnergy | ResidualPrior)]
            raise ValueError(
                f"this optimizer needs terms that are sums of squares with weights above 0; {name!r} is not one, "
                f"those that are: {', '.join(squares) or 'none'}"
            )
        return term.residuals(*given)

    @staticmethod
    def _gradient(energy: Tensor, leaves: Variables) -> Variables:
        if not energy.requires_grad:  # no term has a weight at this step
            return {name: torch.zeros_like(leaf) for name, leaf in leaves.items()}
        slopes = torch.autograd.grad(energy.sum(), list(leaves.values()), allow_unused=True)
        return {
            name: torch.zeros_like(leaf) if slope is None else slope
            for (name, leaf), slope in zip(leaves.items(), slopes, strict=True)
        }

    def _chunks(self, rows: int) -> list[slice]:
        """Even parts of at most `chunk` rows; one part of none, where there are no rows."""
        count = max(1, -(-rows // self.chunk))
        return [slice(rows * part // count, rows * (part + 1) // count) for part in range(count)]

    def _gather(self, problem: Tensor) -> list[Any]:
        """The targets' features for the rows of each chunk, gathered anew only when the rows have changed."""
        if self._rows is None or not torch.equal(self._rows[0], problem):
            self._rows = (problem, [self._targets(problem[rows]) for rows in self._chunks(len(problem))])
        return self._rows[1]

    def _targets(self, problem: Tensor) -> Any:
        return pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, problem), self.prepared)


class _Drawn(NamedTuple):
    """Rows as drawn and compared."""

    values: Variables
    rendering: Rendering
    terms: dict[str, Tensor]
    residuals: list[Tensor]


def _at_least_single(tensor: Tensor) -> Tensor:
    return tensor.to(torch.promote_types(tensor.dtype, torch.float32))


def _joined(chunks: list[Any]) -> Any:
    """One evaluation of all rows: what the chunks hold, tensor by tensor."""
    first = chunks[0]
    if isinstance(first, Tensor):
        return torch.cat(chunks)
    if isinstance(first, dict):
        return {name: _joined([chunk[name] for chunk in chunks]) for name in first}
    return None if first is None else type(first)(**_joined([vars(chunk) for chunk in chunks]))
