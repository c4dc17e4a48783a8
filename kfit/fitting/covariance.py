"""Uncertainty of the answers of least-squares fits."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import FitResult, Observation, Variables
from kfit.fitting.objective import Objective
from kfit.fitting.pipeline import FitPipeline
from kfit.fitting.prepared_terms import PreparedTerms

# Unknowns of a problem: the Jacobian needs a backward pass for each.
MAX_UNKNOWNS = 256


def answer_covariance(pipeline: FitPipeline, observation: Observation, result: FitResult) -> Tensor:
    """Compute the covariance (B, P, P) of the winners of a fit, in the tangent space of its variables.

    With residuals r and their Jacobian J with respect to a step of all variables at the answer,
    C = |r|² / (M − P) · (JᵀJ)⁻¹, the linear theory of least squares (Nocedal and Wright 2006, section 10.1) for M
    residuals of non-zero weight with independent, identically distributed errors. If the drawing cannot explain the
    picture, errors of neighbouring residuals are correlated, and C is too small. Alternatives far from the winner are
    not covered; see the surviving starts of the result.

    The P numbers are steps of the generator's variables, concatenated in their order: for
    `kfit.generators.MeshInCamera` 6, a rotation δ about the object's own axes, R · exp([δ]×), in radians, and the
    translation in the unit of the mesh and the camera's axes. Angles and rotations are in radians here; the step of a
    positive variable is of its logarithm.

    Args:
        pipeline: the pipeline of the fit, whose energies and priors are sums of squares; the weights of its last step
            are used.
        observation: the fitted observation.
        result: result that ``pipeline`` returned for it.

    Returns:
        Symmetric and positive; infinite for a problem whose answer the picture does not determine, NaN for a failed
        one.

    Raises:
        ValueError: if a problem has more than 256 unknowns, or a term is not a sum of squares.

    Example:
        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.fitting import answer_covariance
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import LevenbergMarquardt
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start, optimizer = [Constant({"shift": 0.0})], LevenbergMarquardt()
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, optimizer, num_starts=1)
        >>> noisy = kfit.Observation((blob + 0.01 * torch.randn(1, 32, 32))[None])
        >>> covariance = answer_covariance(fit, noisy, fit(noisy, seed=0))
        >>> covariance.diagonal(dim1=1, dim2=2).sqrt() < 1e-3  # in half-widths: 0.016 pixels
        tensor([[True, True]])
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
