"""What a pipeline's optimizer asks: how good are these rows, and which way is down?"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

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
from kfit.core.pictures import at_least_single
from kfit.fitting.check_parts import check_reached, check_rendering, check_sizes, check_term
from kfit.fitting.overlap import joint_weight, overlap_of, shortfall, too_little

# Pixels that are drawn at once. On a CPU what a chunk of 16 pictures of 64 × 64 needs stays in the cache and is memory
# that is used again: 120 at once take 1.7 times as long a picture, and 2 as long again as 16.
CHUNK_PIXELS = {"cpu": 16 * 64 * 64}
CHUNK_PIXELS_ELSEWHERE = 512 * 64 * 64


class Objective:
    """The `kfit.core.Evaluate` of one fit: draws rows, compares them with targets whose features it holds.

    Rows are drawn in chunks, so that memory does not grow with their number; no row's answer depends on others. Under
    ``torch.autocast`` the generator draws in its precision, and of the terms those compare in it that say they can.

    Where a rendering has a weight, each energy compares under its product with the observation's weight, so a row's
    energy is a mean over what both count, as in airlab's masked losses. The *overlap* of a row is
    o = Σ w_rendering · w_observation / Σ w_observation. A row with o < ``min_overlap``, or of no overlap, cannot win:
    its ranking energy is infinite (ITK 4 gives the largest number to rows of no valid points; elastix stops below its
    RequiredRatioOfValidSamples, 0.25). Its descended energy has the residual √(Σ_k |w_k|) · (1 − o / min_overlap) more,
    with the weights w_k of the energies, which leads it back.

    Args:
        generator: frozen.
        terms: energies and priors by name, frozen.
        rank_weights: weights by which rows are ranked.
        observation: B problems.
        min_overlap: least overlap of a row that may win.

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
        min_overlap: float,
    ) -> None:
        self.observation, self.min_overlap = observation, min_overlap
        self.generator, self.terms, self.rank_weights = generator, terms, rank_weights
        self.spaces = {name: variable.space for name, variable in generator.variables.items()}
        self.weights: dict[str, float] = {}
        self.num_evaluations = 0
        self.device = observation.image.device.type
        self.prepared: dict[str, Any] = {}
        for name, term in self.terms.items():
            if isinstance(term, Energy):
                term.check(observation.select(term.on), observation.weight)
            with self._precision(term):
                self.prepared[name] = (
                    term.prepare(observation.select(term.on), observation.weight)
                    if isinstance(term, Energy)
                    else term.prepare(observation)
                )
        self._reached = False
        self._rows: tuple[Tensor, list[Any]] | None = None
        size = observation.image[0, 0].numel()
        pixels = CHUNK_PIXELS.get(observation.image.device.type, CHUNK_PIXELS_ELSEWHERE)
        self.chunk = max(1, pixels // size)

    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Draw and compare.

        Raises:
            ValueError: if residuals are asked for and a term that is descended is no sum of squares.
        """
        self.num_evaluations += len(problem)
        prepared = self._gather(problem)
        chunks = [
            self._evaluate({name: tensor[rows] for name, tensor in raw.items()}, problem[rows], prepared[number], need)
            for number, rows in enumerate(self._chunks(len(problem)))
        ]
        joined: Evaluation = _joined(chunks)
        return joined

    def _evaluate(self, raw: Variables, problem: Tensor, prepared: Any, need: Need) -> Evaluation:
        wants, rows = need == "gradient", len(problem)
        terms: dict[str, Tensor] = {}
        residuals: list[Tensor] = []
        with torch.set_grad_enabled(wants):
            leaves = {name: tensor.detach().requires_grad_(wants) for name, tensor in raw.items()}
            values = {name: self.spaces[name].to_value(leaf) for name, leaf in leaves.items()}
            drawn = self.generator(**values)
            check_rendering(self.generator, drawn)
            rendering: Rendering = drawn.map(at_least_single)
            observed = self._rows_of(self.observation.weight, problem)
            joint = None if rendering.weight is None else joint_weight(rendering.weight, observed)
            for name, term in self.terms.items():
                weight = self.weights[name]
                if not weight and not self.rank_weights.get(name):
                    continue
                selected = self._values(term, values) if isinstance(term, Prior) else rendering.select(term.on)
                target = prepared[name]
                if isinstance(term, Energy):
                    check_sizes(name, term, rendering, self.observation)
                if joint is not None and isinstance(term, Energy):
                    with torch.set_grad_enabled(wants and bool(weight)), self._precision(term):
                        target = term.prepare(self._rows_of(self.observation.select(term.on), problem), joint)
                given = (selected,) if target is None else (selected, target)
                if need == "residuals" and weight:
                    with self._precision(term):
                        parts = self._residuals(name, given)
                    check_term(name, term, parts, rows, residuals=True)
                    residuals.append(weight**0.5 * parts)
                    terms[name] = parts.square().sum(1)
                    continue
                # What only ranks has no slope.
                with torch.set_grad_enabled(wants and bool(weight)), self._precision(term):
                    terms[name] = term(*given) if isinstance(term, Prior) else term.compare(*given)
                check_term(name, term, terms[name], rows)
            energy = torch.stack([self.weights[name] * term for name, term in terms.items()]).sum(0)
            ranking = torch.stack([self.rank_weights.get(name, 0.0) * term for name, term in terms.items()]).sum(0)
            if joint is not None:
                overlap = overlap_of(joint, observed)
                compared = [abs(self.weights[name]) for name, term in self.terms.items() if isinstance(term, Energy)]
                missing = sum(compared) ** 0.5 * shortfall(overlap, self.min_overlap)
                residuals += [missing[:, None]] if need == "residuals" else []
                energy = energy + missing.square()
                ranking = ranking.masked_fill(too_little(overlap, self.min_overlap), torch.inf)
            gradient = self._gradient(energy, leaves) if wants else None
        if need == "residuals":
            residuals = residuals or [energy.new_zeros(rows, 0)]
        return Evaluation(
            energy=energy.detach(),
            ranking=ranking.detach(),
            terms={name: term.detach() for name, term in terms.items()},
            values={name: value.detach() for name, value in values.items()},
            gradient=gradient,
            residuals=torch.cat(residuals, 1) if residuals else None,
            rendering=rendering.map(Tensor.detach),
        )

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

    def _gradient(self, energy: Tensor, leaves: Variables) -> Variables:
        slopes: tuple[Tensor | None, ...] = (None,) * len(leaves)
        if energy.requires_grad:
            slopes = torch.autograd.grad(energy.sum(), list(leaves.values()), allow_unused=True)
        if not self._reached and len(energy):
            missing = [name for name, slope in zip(leaves, slopes, strict=True) if slope is None]
            check_reached(self.generator, self.terms, leaves, missing)
            self._reached = True
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
        return self._rows_of(self.prepared, problem)

    @staticmethod
    def _rows_of(targets: Any, problem: Tensor) -> Any:
        return pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, problem), targets)


def _joined(chunks: list[Any]) -> Any:
    """One evaluation of all rows: what the chunks hold, tensor by tensor."""
    first = chunks[0]
    if isinstance(first, Tensor):
        return torch.cat(chunks)
    if isinstance(first, dict):
        return {name: _joined([chunk[name] for chunk in chunks]) for name in first}
    return None if first is None else type(first)(**_joined([vars(chunk) for chunk in chunks]))
