"""Answers of fits as differentiable functions of the pictures, by the implicit function theorem."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import FitResult, Observation, Variables
from kfit.fitting.objective import Objective
from kfit.fitting.pipeline import FitPipeline
from kfit.fitting.prepared_terms import PreparedTerms

# Unknowns of a problem: the curvature needs a backward pass for each.
MAX_UNKNOWNS = 256


def differentiable_answer(pipeline: FitPipeline, observation: Observation, result: FitResult) -> Variables:
    """Return the winners of a fit with gradients with respect to the observation, such as the target picture.

    At a minimum the gradient g(x, y) of the energy with respect to the variables x is 0 for every observation y; hence
    dx/dy = −H⁻¹ ∂g/∂y with H = ∂g/∂x (Gould et al., "On differentiating parameterized argmin and argmax problems",
    2016, lemma 3.2). This holds at minima, so fit to convergence, with `kfit.optimizers.LBFGS` or
    `kfit.optimizers.LevenbergMarquardt`, and in double precision for exact gradients. The generator and the energies
    must be twice differentiable.

    Args:
        pipeline: the pipeline of the fit; the weights of its last step are used.
        observation: the fitted observation, with tensors that require gradients.
        result: result that ``pipeline`` returned for it.

    Returns:
        The winners (B, \\*shape), moved by one Newton step, with gradients with respect to the observation; NaN for a
        problem whose starts all failed.

    Raises:
        ValueError: if a problem has more than 256 unknowns, or the energy does not increase in every direction from
            an answer.

    Example:
        >>> import torch, kfit
        >>> from kfit.core import Observation
        >>> from kfit.fitting import differentiable_answer
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import LevenbergMarquardt
        >>> picture = torch.rand(1, 3, 3, dtype=torch.float64)
        >>> picture = torch.nn.functional.interpolate(picture[None], (16, 16), mode="bicubic")
        >>> start = Constant({"shift": 0.0})
        >>> fit = kfit.FitPipeline(
        ...     Template(picture[0], "translation"), {"l2": L2()}, [start], LevenbergMarquardt(), num_starts=1
        ... )
        >>> target = picture.clone().requires_grad_()
        >>> answer = differentiable_answer(fit, Observation(target), fit(Observation(target.detach()), seed=0))
        >>> answer["shift"].square().sum().backward()
        >>> target.grad.shape
        torch.Size([1, 1, 16, 16])
    """
    variables = pipeline.generator.variables
    values = {name: result.values[name].detach() for name in variables}
    raw = {name: variables[name].space.to_raw(value) for name, value in values.items()}
    count = sum(tensor[0].numel() for tensor in raw.values())
    if count > MAX_UNKNOWNS:
        raise ValueError(f"an answer of {count} unknowns is too large to differentiate; at most {MAX_UNKNOWNS} are")
    weights = pipeline.weights_at(pipeline.num_steps)
    with torch.enable_grad():
        prepared = PreparedTerms(pipeline.generator, pipeline.terms, observation)
        objective = Objective(prepared, weights, weights, pipeline.min_overlap)
        problem = torch.arange(observation.num_problems, device=observation.image.device)
        steps = [torch.zeros_like(tensor, requires_grad=True) for tensor in raw.values()]
        energy = objective.energy_of(objective.retract(raw, dict(zip(raw, steps, strict=True))), problem)
        slopes = torch.autograd.grad(energy.sum(), steps, create_graph=True, materialize_grads=True)
        slope = torch.cat([part.reshape(len(part), -1) for part in slopes], 1)
        curvature = _curvature(slope, steps)
        _check_minimum(curvature)
        newton = -torch.linalg.solve_ex(curvature, slope[..., None])[0][..., 0]
        sizes = [tensor[0].numel() for tensor in raw.values()]
        parts = {name: part.reshape(raw[name].shape) for name, part in zip(raw, newton.split(sizes, 1), strict=True)}
        moved = objective.retract(raw, parts)
        return {name: variables[name].space.to_value(tensor) for name, tensor in moved.items()}


def _curvature(slope: Tensor, steps: list[Tensor]) -> Tensor:
    """Return second derivatives (B, P, P) of each problem's energy, without a graph."""
    rows = []
    for number in range(slope.shape[1]):
        second = torch.autograd.grad(slope[:, number].sum(), steps, retain_graph=True, materialize_grads=True)
        rows.append(torch.cat([part.reshape(len(part), -1) for part in second], 1).detach())
    return torch.stack(rows, 1)


def _check_minimum(curvature: Tensor) -> None:
    """Refuse problems at whose answers the energy does not increase in every direction; NaN is not refused."""
    whole = curvature.isfinite().flatten(1).all(1)[:, None, None]
    eye = torch.eye(curvature.shape[1], dtype=curvature.dtype, device=curvature.device)
    spectrum = torch.linalg.eigvalsh(curvature.where(whole, eye))
    if bool((spectrum[:, 0] <= 1e-9 * spectrum[:, -1]).any()):
        raise ValueError(
            "the energy does not rise in every direction from the answer: fit to convergence, or hold variables that "
            "change nothing"
        )
