"""Checks of what the parts of a fit return: each error names the part and the remedy in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core import (
    Callback,
    Energy,
    FitState,
    Generator,
    Observation,
    Optimizer,
    Prior,
    Rendering,
    Selector,
    Variables,
)
from kfit.fitting.check_parts import check_kind


def check_rendering(generator: Generator, rendering: Any) -> None:
    """Refuse anything but a rendering.

    Raises:
        TypeError: naming the generator.
    """
    remedy = "return kfit.core.Rendering(image)" if isinstance(rendering, Tensor) else ""
    check_kind(f"what {type(generator).__name__}.forward returns", rendering, Rendering, remedy=remedy)


def check_sizes(name: str, term: Energy, rendering: Rendering, observation: Observation) -> None:
    """Refuse drawings of another size than the observation, which energies on networks would compare nevertheless.

    Raises:
        ValueError: naming the term, the field and both sizes.
    """
    for field in [term.on] if isinstance(term.on, str) else term.on:
        drawn, observed = (tuple(of.field(field).shape[1:]) for of in (rendering, observation))
        if drawn != observed:
            raise ValueError(f"energies.{name}: the drawn {field} must have shape {observed} as observed, got {drawn}")


def check_reached(
    generator: Generator,
    terms: Mapping[str, Energy | Prior],
    raw: Variables,
    context: Mapping[str, Tensor],
    missing: Sequence[str],
) -> None:
    """Refuse a generator through which no gradient reaches a variable, whatever the energies are.

    Args:
        generator: draws.
        terms: terms of the fit; variables of priors need not change the drawing.
        raw: (N, \\*shape) each, N at least 1; one row is drawn.
        context: the result of the generator's `prepare`, by row.
        missing: variables on which the energies do not depend.

    Raises:
        ValueError: naming them.
    """
    priors = [[term.on] if isinstance(term.on, str) else term.on for term in terms.values() if isinstance(term, Prior)]
    missing = [name for name in missing if not any(name in on for on in priors)]
    if not missing:
        return
    one = {name: tensor[:1].detach().requires_grad_() for name, tensor in raw.items()}
    values = {name: generator.variables[name].space.to_value(tensor) for name, tensor in one.items()}
    drawn = generator(**values, **{name: tensor[:1] for name, tensor in context.items()})
    parts = [part.sum() for part in vars(drawn).values() if isinstance(part, Tensor) and part.requires_grad]
    slopes = torch.autograd.grad(parts, [one[name] for name in missing], allow_unused=True) if parts else ()
    if lost := [name for number, name in enumerate(missing) if not parts or slopes[number] is None]:
        raise ValueError(
            f"no gradient reaches {', '.join(lost)} through {type(generator).__name__}: its forward must not detach, "
            "round or leave torch; else take an optimizer without gradients, kfit.optimizers.CMAES"
        )


def check_term(name: str, term: Any, found: Any, rows: int, residuals: bool = False) -> None:
    """Refuse energies that are not (N,), and residuals that are not (N, M).

    Raises:
        TypeError, ValueError: naming the term.
    """
    kind, method = (
        type(term).__name__,
        "residuals" if residuals else "forward" if isinstance(term, Prior) else "compare",
    )
    wanted = f"({rows}, M)" if residuals else f"({rows},)"
    if not isinstance(found, Tensor):
        raise TypeError(
            f"energies.{name}: {kind}.{method} must return a tensor of {wanted}, got {type(found).__name__}"
        )
    if found.dim() == 1 + residuals and len(found) == rows:
        return
    remedy = ": average over all axes but the first" if not residuals else ""
    raise ValueError(f"energies.{name}: {kind}.{method} must return shape {wanted}, got {tuple(found.shape)}{remedy}")


def check_memory(optimizer: Optimizer, memory: Any, rows: int) -> None:
    """Refuse an optimizer's memory in which a tensor does not lead with rows, because rows could not be removed.

    Raises:
        ValueError: naming the optimizer and the tensor.
    """
    for path, leaf in pytree.tree_flatten_with_path(memory)[0]:
        if isinstance(leaf, Tensor) and (leaf.dim() == 0 or len(leaf) != rows):
            raise ValueError(
                f"optimizer: tensors in the memory of {type(optimizer).__name__} must lead with rows, {rows} here, got "
                f"shape {tuple(leaf.shape)} at memory{pytree.keystr(path)}: expand it, or keep a plain number"
            )


def check_state(callback: Callback, state: Any) -> None:
    """Refuse anything but a state as the result of a callback.

    Raises:
        TypeError: naming the callback.
    """
    remedy = "end it with `return state`" if state is None else ""
    check_kind(f"what {type(callback).__name__}.on_step returns", state, FitState, remedy=remedy)


def check_winner(selector: Selector, winner: Any, problem: Tensor) -> None:
    """Refuse a selection that is not one row of each problem, in order.

    Raises:
        TypeError, ValueError: naming the selector.
    """
    count, name = int(problem.max()) + 1, type(selector).__name__
    if not isinstance(winner, Tensor) or winner.is_floating_point() or winner.dtype == torch.bool:
        came = str(winner.dtype) if isinstance(winner, Tensor) else type(winner).__name__
        raise TypeError(f"selector: {name} must return numbers of rows, a long tensor of shape ({count},), got {came}")
    if tuple(winner.shape) != (count,):
        raise ValueError(f"selector: {name} must return one row of each problem, ({count},), got {tuple(winner.shape)}")
    if not bool(((winner >= 0) & (winner < len(problem))).all()):
        raise ValueError(f"selector: {name} must return rows 0 to {len(problem) - 1}, got {winner.tolist()}")
    owners = problem[winner]
    if wrong := (owners != torch.arange(count, device=owners.device)).nonzero()[:, 0].tolist():
        first = wrong[0]
        raise ValueError(f"selector: {name} returned a row of problem {int(owners[first])} as the winner of {first}")
