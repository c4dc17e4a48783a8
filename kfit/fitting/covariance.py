"""How uncertain the answers of fits of sums of squares are."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import FitResult, Observation, Variables
from kfit.fitting.objective import Objective
from kfit.fitting.pipeline import FitPipeline
from kfit.fitting.prepared_terms import PreparedTerms

# Unknowns of a problem: the Jacobian takes a pass backwards for each.
MAX_UNKNOWNS = 256


def answer_covariance(pipeline: FitPipeline, observation: Observation, result: FitResult) -> Tensor:
    """Covariance (B, P, P) of the winners of a fit, in the tangent space of its variables.

    With residuals r and their Jacobian J by a step of all variables at the answer, C = |r|² / (M − P) · (JᵀJ)⁻¹, the
    linear theory of least squares (Nocedal and Wright 2006, section 10.1): M residuals that count, whose errors are
    independent and alike. Where the drawing cannot explain the picture, neighbouring residuals err together, and C is
    too small; alternatives far from the winner are not in it, for which see the result's surviving starts.

    The P numbers are steps of the generator's variables laid end to end, in their order: for
    `kfit.generators.MeshInCamera` 6, a turn δ about the object's own axes, R · exp([δ]×), in radians, and the
    translation in the unit of the mesh and the camera's axes. Angles and rotations are in radians here; a positive
    variable's step is of its logarithm.

    Args:
        pipeline: that made the fit, of energies and priors that are sums of squares; its last step's weights count.
        observation: that was fitted.
        result: of ``pipeline`` for it.

    Returns:
        Symmetric and positive; infinite for a problem whose answer the picture does not fix, NaN for one that failed.

    Raises:
        ValueError: for more than 256 unknowns a problem, and a term that is no sum of squares.
    """
    variables = pipeline.generator.variables
    raw: Variables = {name: variables[name].space.to_raw(result.values[name].detach()) for name in variables}
    scale = torch.cat(
        [tensor.new_full((tensor[0].numel(),), variables[name].space.radians) for name, tensor in raw.items()]
    )
    count = len(scale)
    if count > MAX_UNKNOWNS:
        raise ValueError(f"an answer of {count} unknowns is too large for its covariance; at most {MAX_UNKNOWNS} are")
    weights = pipeline.weights_at(pipeline.num_steps)
    prepared = PreparedTerms(pipeline.generator, pipeline.terms, observation)
    objective = Objective(prepared, weights, weights, pipeline.min_overlap)
    problem = torch.arange(observation.num_problems, device=observation.image.device)
    with torch.no_grad():
        residuals = objective(raw, problem, need="residuals").residuals
        linear = objective.linearize(raw, problem)
        steps = torch.eye(count).to(residuals)
        jacobian = torch.stack([linear.push(step.expand(len(problem), -1)) for step in steps], 2) / scale
        counted = ((residuals != 0) | (jacobian != 0).any(2)).sum(1)
        variance = residuals.square().sum(1) / (counted - count).clamp_min(1)
        squares = jacobian.mT @ jacobian
        whole = squares.isfinite().flatten(1).all(1)
        spectrum, axes = torch.linalg.eigh(squares.where(whole[:, None, None], torch.eye(count).to(squares)))
        flat = spectrum <= 1e-9 * spectrum[:, -1:]
        inverse = (axes / spectrum.where(~flat, 1.0)[:, None]) @ axes.mT
        found: Tensor = variance[:, None, None] * inverse
        found = found.masked_fill(flat.any(1)[:, None, None], torch.inf).masked_fill(~whole[:, None, None], torch.nan)
        return found
