"""The objective of a fit: draws rows, compares them, and returns energies and derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, overload

import torch
from torch import Tensor

from kfit.core import (
    Energy,
    Evaluation,
    GradientEvaluation,
    PicturesEvaluation,
    Prior,
    ResidualEnergy,
    ResidualEvaluation,
    ResidualPrior,
    Variables,
)
from kfit.core.evaluate import Need
from kfit.fitting.check_outputs import check_sizes, check_term
from kfit.fitting.drawn_rows import DrawnRows, RowInputs, joined_evaluation
from kfit.fitting.jacobian import JacobianProducts
from kfit.fitting.overlap import joint_weight, overlap_of, shortfall, too_little
from kfit.fitting.prepared_terms import PreparedTerms, rows_of


class Objective:
    """The `kfit.core.Evaluate` of one step: draws rows, and compares them under the step's weights.

    Rows are drawn in chunks, so that memory does not grow with their number; no row's result depends on other rows.
    Under ``torch.autocast`` the generator draws in its precision, and energies with ``mixed`` compare in it.

    If a rendering has a weight, each energy uses its product with the observation's weight, so a row's energy is a mean
    over the pixels of both, as in airlab's masked losses. The *overlap* of a row is
    o = Σ w_rendering · w_observation / Σ w_observation. A row with o < ``min_overlap``, or without overlap, cannot win:
    its ranking energy is infinite (ITK 4 returns the largest number for rows without valid points; elastix stops below
    its RequiredRatioOfValidSamples, 0.25). Its minimised energy has an additional residual
    √(Σ_k |w_k|) · (1 − o / min_overlap), with the weights w_k of the energies, which leads it back.

    Args:
        prepared: generator and terms, and what they prepared of the observation.
        weights: weights of the terms in the energy that is minimised, by name.
        rank_weights: weights of the terms in the energy by which rows are ranked; 0 for terms not named.
        min_overlap: least overlap of a row that may win.
    """

    def __init__(
        self,
        prepared: PreparedTerms,
        weights: Mapping[str, float],
        rank_weights: Mapping[str, float],
        min_overlap: float,
    ) -> None:
        self.prepared, self.weights, self.rank_weights = prepared, weights, rank_weights
        self.min_overlap = min_overlap

    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["value"] = "value") -> Evaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["gradient"]) -> GradientEvaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["residuals"]) -> ResidualEvaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["pictures"]) -> PicturesEvaluation: ...
    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Draw and compare rows.

        Raises:
            ValueError: if residuals are requested and a minimised term is not a sum of squares.
        """
        chunks = self.prepared.chunks(raw, problem)
        return joined_evaluation([self._evaluate(part, rows, need) for part, rows in chunks])

    def retract(self, raw: Variables, step: Variables) -> Variables:
        """Return raw variables after a step, each in its own space."""
        spaces = self.prepared.spaces
        return {name: spaces[name].retract(tensor.detach(), step[name]) for name, tensor in raw.items()}

    def linearize(self, raw: Variables, problem: Tensor) -> JacobianProducts:
        """Draw rows once and keep their graphs, for products with the Jacobian of their residuals.

        Raises:
            ValueError: if a minimised term is not a sum of squares.
        """
        parts = []
        for part, rows in self.prepared.chunks(raw, problem):
            with torch.enable_grad():
                steps = {name: torch.zeros_like(tensor, requires_grad=True) for name, tensor in part.items()}
                drawn = self._draw(self.retract(part, steps), rows, "residuals")
                parts.append((list(steps.values()), torch.cat(drawn.residuals, 1)))
        return JacobianProducts(parts)

    def energy_of(self, raw: Variables, problem: Tensor) -> Tensor:
        """Return minimised energies (N,) of rows drawn at once, with the graph of ``raw`` and of the observation."""
        return self._descended(self._draw(raw, self.prepared.gather(problem), "value"))

    def _descended(self, drawn: DrawnRows) -> Tensor:
        energy = torch.stack([self.weights[name] * term for name, term in drawn.terms.items()]).sum(0)
        return energy if drawn.missing is None else energy + drawn.missing.square()

    def _evaluate(self, raw: Variables, rows: RowInputs, need: Need) -> Evaluation:
        wants = need == "gradient"
        with torch.set_grad_enabled(wants):
            steps = {name: torch.zeros_like(tensor, requires_grad=wants) for name, tensor in raw.items()}
            drawn = self._draw(self.retract(raw, steps) if wants else raw, rows, need)
            energy = self._descended(drawn)
            gradient = self._gradient(energy, steps, raw, rows) if wants else {}
        ranked = [self.rank_weights.get(name, 0.0) * term.detach() for name, term in drawn.terms.items()]
        ranking = torch.stack(ranked).sum(0)
        if drawn.overlap is not None:
            ranking = ranking.masked_fill(too_little(drawn.overlap, self.min_overlap), torch.inf)
        terms = {name: term.detach() for name, term in drawn.terms.items()}
        values = {name: value.detach() for name, value in drawn.values.items()}
        found = Evaluation(energy.detach(), ranking, terms, values, drawn.rendering.map(Tensor.detach))
        if need == "gradient":
            return GradientEvaluation(**vars(found), gradient=gradient)
        if need == "pictures":
            fields = vars(self.prepared.observation).items()
            observed = {name: value for name, value in fields if isinstance(value, Tensor)}
            return PicturesEvaluation(**vars(found), observed=rows_of(observed, rows.picture))
        return found if need == "value" else ResidualEvaluation(**vars(found), residuals=torch.cat(drawn.residuals, 1))

    def _draw(self, raw: Variables, rows: RowInputs, need: Need) -> DrawnRows:
        """Draw rows and compare them, with a graph where gradients are enabled."""
        prepared, observation, views = self.prepared, self.prepared.observation, self.prepared.views
        values, rendering = prepared.draw(raw, rows)
        count, observed = len(rows.problem), rows_of(observation.weight, rows.picture)
        joint = None if rendering.weight is None else joint_weight(rendering.weight, observed)
        terms: dict[str, Tensor] = {}
        # Stays empty if no term is minimised.
        residuals = [rendering.image.new_zeros(count, 0)]
        for name, term in prepared.terms.items():
            weight = self.weights[name]
            if not weight and not self.rank_weights.get(name):
                continue
            target = rows.targets[name]
            # Terms that only rank need no gradient.
            with torch.set_grad_enabled(torch.is_grad_enabled() and bool(weight)), prepared.precision(term):
                if isinstance(term, Energy):
                    check_sizes(name, term, rendering, observation)
                if joint is not None and isinstance(term, Energy):
                    target = term.prepare(rows_of(observation.select(term.on), rows.picture), joint)
                selected = self._values(term, values) if isinstance(term, Prior) else rendering.select(term.on)
                inputs = (selected,) if target is None else (selected, target)
                pictures = count if isinstance(term, Prior) else count * views
                if need == "residuals" and weight:
                    parts = self._residuals(name, inputs)
                    check_term(name, term, parts, pictures, residuals=True)
                    if isinstance(term, Energy):  # the mean over the views
                        parts = parts.reshape(count, views * parts.shape[1]) / views**0.5
                    residuals.append(weight**0.5 * parts)
                    terms[name] = parts.square().sum(1)
                else:
                    found = term(*inputs) if isinstance(term, Prior) else term.compare(*inputs)
                    check_term(name, term, found, pictures)
                    terms[name] = found if isinstance(term, Prior) else found.view(count, views).mean(1)
        overlap = missing = None
        if joint is not None:
            # One number for all views of a row.
            counted = None if observed is None else observed.unflatten(0, (-1, views))
            overlap = overlap_of(joint.unflatten(0, (-1, views)), counted)
            compared = [abs(self.weights[name]) for name, term in prepared.terms.items() if isinstance(term, Energy)]
            missing = sum(compared) ** 0.5 * shortfall(overlap, self.min_overlap)
            residuals.append(missing[:, None])
        return DrawnRows(values, rendering, terms, residuals, overlap, missing)

    @staticmethod
    def _values(prior: Prior, values: Variables) -> Any:
        return values[prior.on] if isinstance(prior.on, str) else {name: values[name] for name in prior.on}

    def _residuals(self, name: str, inputs: tuple[Any, ...]) -> Tensor:
        term = self.prepared.terms[name]
        if self.weights[name] < 0 or not isinstance(term, ResidualEnergy | ResidualPrior):
            squares = [n for n, t in self.prepared.terms.items() if isinstance(t, ResidualEnergy | ResidualPrior)]
            raise ValueError(
                f"this optimizer needs terms that are sums of squares with weights above 0; {name!r} is not one, "
                f"those that are: {', '.join(squares) or 'none'}"
            )
        return term.residuals(*inputs)

    def _gradient(self, energy: Tensor, steps: Variables, raw: Variables, rows: RowInputs) -> Variables:
        slopes: tuple[Tensor | None, ...] = (None,) * len(steps)
        if energy.requires_grad:
            slopes = torch.autograd.grad(energy.sum(), list(steps.values()), allow_unused=True)
        missing = [name for name, slope in zip(steps, slopes, strict=True) if slope is None]
        self.prepared.check_reached(raw, rows, missing)
        return {
            name: torch.zeros_like(step) if slope is None else slope
            for (name, step), slope in zip(steps.items(), slopes, strict=True)
        }
