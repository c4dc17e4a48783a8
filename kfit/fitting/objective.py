"""The objective of a fit: draws rows, compares them, and returns energies and derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
from kfit.core.rows import pictures_of
from kfit.fitting.check_parts import check_reached, check_rendering, check_sizes, check_term
from kfit.fitting.drawn_rows import DrawnRows, RowInputs, joined_evaluation
from kfit.fitting.jacobian import JacobianProducts
from kfit.fitting.overlap import joint_weight, overlap_of, shortfall, too_little

# Pixels that are drawn at once. On a CPU a chunk of 16 pictures of 64 × 64 fits the cache and reuses its memory: with
# 120 at once a picture takes 1.7 × as long, with 2 at once as long as with 16.
CHUNK_PIXELS = {"cpu": 16 * 64 * 64}
CHUNK_PIXELS_ELSEWHERE = 512 * 64 * 64


class Objective:
    """The `kfit.core.Evaluate` of one fit: draws rows and compares them with prepared targets.

    Rows are drawn in chunks, so that memory does not grow with their number; no row's result depends on other rows.
    Under ``torch.autocast`` the generator draws in its precision, and energies with ``mixed`` compare in it.

    If a rendering has a weight, each energy uses its product with the observation's weight, so a row's energy is a mean
    over the pixels of both, as in airlab's masked losses. The *overlap* of a row is
    o = Σ w_rendering · w_observation / Σ w_observation. A row with o < ``min_overlap``, or without overlap, cannot win:
    its ranking energy is infinite (ITK 4 returns the largest number for rows without valid points; elastix stops below
    its RequiredRatioOfValidSamples, 0.25). Its minimised energy has an additional residual
    √(Σ_k |w_k|) · (1 − o / min_overlap), with the weights w_k of the energies, which leads it back.

    Args:
        generator: frozen.
        terms: energies and priors by name, frozen.
        rank_weights: weights by which rows are ranked.
        observation: B problems.
        min_overlap: least overlap of a row that may win.

    Attributes:
        weights: of the terms in the minimised energy; the pipeline sets them before each step.
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
        self.device, self.views = observation.image.device.type, observation.views
        self.prepared: dict[str, Any] = {}
        for name, term in self.terms.items():
            if isinstance(term, Energy):
                term.check(observation.select(term.on), observation.weight)
            with self._precision(term):
                self.prepared[name] = (
                    term.prepare(observation.select(term.on), observation.weight)
                    if isinstance(term, Energy)
                    else term.prepare(observation.first_views())
                )
        self.context = dict(generator.prepare(observation))
        self._reached = False
        self._rows: tuple[Tensor, list[RowInputs]] | None = None
        size = observation.image[0, 0].numel()
        pixels = CHUNK_PIXELS.get(self.device, CHUNK_PIXELS_ELSEWHERE)
        self.chunk = max(1, pixels // (size * self.views))

    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Draw and compare rows.

        Raises:
            ValueError: if residuals are requested and a minimised term is not a sum of squares.
        """
        return joined_evaluation([self._evaluate(part, rows, need) for part, rows in self._chunks(raw, problem)])

    def retract(self, raw: Variables, step: Variables) -> Variables:
        """Return raw variables after a step, each in its own space."""
        return {name: self.spaces[name].retract(tensor.detach(), step[name]) for name, tensor in raw.items()}

    def linearize(self, raw: Variables, problem: Tensor) -> JacobianProducts:
        """Draw rows once and keep their graphs, for products with the Jacobian of their residuals.

        Raises:
            ValueError: if a minimised term is not a sum of squares.
        """
        parts = []
        for part, rows in self._chunks(raw, problem):
            with torch.enable_grad():
                steps = {name: torch.zeros_like(tensor, requires_grad=True) for name, tensor in part.items()}
                drawn = self._draw(self.retract(part, steps), rows, "residuals")
                parts.append((list(steps.values()), torch.cat(drawn.residuals, 1)))
        return JacobianProducts(parts)

    def energy_of(self, raw: Variables, problem: Tensor) -> Tensor:
        """Return minimised energies (N,) of rows drawn at once, with the graph of ``raw`` and of the observation."""
        return self._descended(self._draw(raw, self._gather(problem), "value"))

    def _descended(self, drawn: DrawnRows) -> Tensor:
        energy = torch.stack([self.weights[name] * term for name, term in drawn.terms.items()]).sum(0)
        return energy if drawn.missing is None else energy + drawn.missing.square()

    def _evaluate(self, raw: Variables, rows: RowInputs, need: Need) -> Evaluation:
        wants = need == "gradient"
        with torch.set_grad_enabled(wants):
            steps = {name: torch.zeros_like(tensor, requires_grad=wants) for name, tensor in raw.items()}
            drawn = self._draw(self.retract(raw, steps) if wants else raw, rows, need)
            energy = self._descended(drawn)
            gradient = self._gradient(energy, steps, raw, rows) if wants else None
        ranked = [self.rank_weights.get(name, 0.0) * term.detach() for name, term in drawn.terms.items()]
        ranking = torch.stack(ranked).sum(0)
        if drawn.overlap is not None:
            ranking = ranking.masked_fill(too_little(drawn.overlap, self.min_overlap), torch.inf)
        return Evaluation(
            energy=energy.detach(),
            ranking=ranking,
            terms={name: term.detach() for name, term in drawn.terms.items()},
            values={name: value.detach() for name, value in drawn.values.items()},
            gradient=gradient,
            residuals=torch.cat(drawn.residuals, 1) if need == "residuals" else None,
            rendering=drawn.rendering.map(Tensor.detach),
            observed=self._observed(rows.picture) if need == "pictures" else None,
        )

    def _observed(self, picture: Tensor) -> dict[str, Tensor]:
        """Fields of the observation for the pictures of these numbers."""
        fields = {name: value for name, value in vars(self.observation).items() if isinstance(value, Tensor)}
        gathered: dict[str, Tensor] = self._rows_of(fields, picture)
        return gathered

    def _draw(self, raw: Variables, rows: RowInputs, need: Need) -> DrawnRows:
        """Draw rows and compare them, with a graph where gradients are enabled."""
        values = {name: self.spaces[name].to_value(tensor) for name, tensor in raw.items()}
        drawn = self.generator(**values, **rows.context)
        check_rendering(self.generator, drawn)
        rendering: Rendering = drawn.map(at_least_single)
        count, observed = len(rows.problem), self._rows_of(self.observation.weight, rows.picture)
        joint = None if rendering.weight is None else joint_weight(rendering.weight, observed)
        terms: dict[str, Tensor] = {}
        # Stays empty if no term is minimised.
        residuals = [rendering.image.new_zeros(count, 0)]
        for name, term in self.terms.items():
            weight = self.weights[name]
            if not weight and not self.rank_weights.get(name):
                continue
            target = rows.targets[name]
            # Terms that only rank need no gradient.
            with torch.set_grad_enabled(torch.is_grad_enabled() and bool(weight)), self._precision(term):
                if isinstance(term, Energy):
                    check_sizes(name, term, rendering, self.observation)
                if joint is not None and isinstance(term, Energy):
                    target = term.prepare(self._rows_of(self.observation.select(term.on), rows.picture), joint)
                selected = self._values(term, values) if isinstance(term, Prior) else rendering.select(term.on)
                given = (selected,) if target is None else (selected, target)
                pictures = count if isinstance(term, Prior) else count * self.views
                if need == "residuals" and weight:
                    parts = self._residuals(name, given)
                    check_term(name, term, parts, pictures, residuals=True)
                    if isinstance(term, Energy):  # the mean over the views
                        parts = parts.reshape(count, self.views * parts.shape[1]) / self.views**0.5
                    residuals.append(weight**0.5 * parts)
                    terms[name] = parts.square().sum(1)
                else:
                    found = term(*given) if isinstance(term, Prior) else term.compare(*given)
                    check_term(name, term, found, pictures)
                    terms[name] = found if isinstance(term, Prior) else found.view(count, self.views).mean(1)
        overlap = missing = None
        if joint is not None:
            # One number for all views of a row.
            seen = None if observed is None else observed.unflatten(0, (-1, self.views))
            overlap = overlap_of(joint.unflatten(0, (-1, self.views)), seen)
            compared = [abs(self.weights[name]) for name, term in self.terms.items() if isinstance(term, Energy)]
            missing = sum(compared) ** 0.5 * shortfall(overlap, self.min_overlap)
            residuals.append(missing[:, None])
        return DrawnRows(values, rendering, terms, residuals, overlap, missing)

    def _precision(self, term: Energy | Prior) -> AbstractContextManager[Any]:
        """Return a context of the current precision for terms that can compare in it, else of single precision."""
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

    def _gradient(self, energy: Tensor, steps: Variables, raw: Variables, rows: RowInputs) -> Variables:
        slopes: tuple[Tensor | None, ...] = (None,) * len(steps)
        if energy.requires_grad:
            slopes = torch.autograd.grad(energy.sum(), list(steps.values()), allow_unused=True)
        if not self._reached and len(energy):
            missing = [name for name, slope in zip(steps, slopes, strict=True) if slope is None]
            check_reached(self.generator, self.terms, raw, rows.context, missing)
            self._reached = True
        return {
            name: torch.zeros_like(step) if slope is None else slope
            for (name, step), slope in zip(steps.items(), slopes, strict=True)
        }

    def _chunks(self, raw: Variables, problem: Tensor) -> Iterator[tuple[Variables, RowInputs]]:
        """Yield even parts of at most `chunk` rows; one empty part if there are no rows.

        The inputs of their problems are gathered again only if the rows have changed.
        """
        rows, count = len(problem), max(1, -(-len(problem) // self.chunk))
        self.num_evaluations += rows * self.views
        parts = [slice(rows * part // count, rows * (part + 1) // count) for part in range(count)]
        if self._rows is None or not torch.equal(self._rows[0], problem):
            self._rows = (problem, [self._gather(problem[part]) for part in parts])
        for part, gathered in zip(parts, self._rows[1], strict=True):
            yield {name: tensor[part] for name, tensor in raw.items()}, gathered

    def _gather(self, problem: Tensor) -> RowInputs:
        picture = pictures_of(problem, self.views)
        targets = {
            name: self._rows_of(prepared, picture if isinstance(self.terms[name], Energy) else problem)
            for name, prepared in self.prepared.items()
        }
        return RowInputs(problem, picture, targets, self._rows_of(self.context, problem))

    @staticmethod
    def _rows_of(targets: Any, problem: Tensor) -> Any:
        return pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, problem), targets)
