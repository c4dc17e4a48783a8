"""Checks of the parts of a fit: each error names the part and the remedy in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils import _pytree as pytree

from kfit.core.check import check_dict, check_names, check_range
from kfit.core.contracts import Callback, Energy, Generator, Initializer, Optimizer, Prior, Schedule, Selector
from kfit.core.state import FitState, Observation, Rendering
from kfit.core.variables import Variables


def check_parts(
    generator: Any, energies: Any, initializers: Any, optimizer: Any, selector: Any, callbacks: Any
) -> None:
    """Refuse parts of the wrong type, a generator without variables, and names that do not match.

    Raises:
        TypeError, ValueError: naming the part, what was expected and what to do.
    """
    check_kind("generator", generator, Generator)
    if not getattr(generator, "variables", None):
        name = type(generator).__name__
        raise ValueError(
            f"generator: {name} has no variables, so there is nothing to fit: name them in its `variables`"
        )
    if isinstance(energies, Energy | Prior):
        name = type(energies).__name__
        raise TypeError(f'energies must be a dict of energies by name, got {name}: {{"{name.lower()}": {name}(…)}}')
    if not isinstance(energies, Mapping):
        raise TypeError(f"energies must be a dict of energies by name, got {type(energies).__name__}")
    if not energies:
        raise ValueError("energies must name at least one energy, got none")
    for name, term in energies.items():
        # `ModuleDict` stores its modules as attributes.
        if not isinstance(name, str) or not name or "." in name or hasattr(nn.ModuleDict(), name):
            raise ValueError(
                f"energies: an energy cannot be named {name!r}; names are not empty, have no dot, and are none of "
                "PyTorch's own, such as 'keys' and 'training'"
            )
        remedy = "" if isinstance(term, type) else "a function or loss becomes an energy by a subclass with `compare`"
        check_kind(f"energies.{name}", term, Energy, Prior, remedy=remedy)
    _check_list("initializers", initializers, Initializer)
    foreign = torch.optim.Optimizer
    remedy = "kfit.optimizers.TorchOptimizer wraps classes of torch.optim"
    torchs = isinstance(optimizer, foreign) or (isinstance(optimizer, type) and issubclass(optimizer, foreign))
    check_kind("optimizer", optimizer, Optimizer, remedy=remedy if torchs else "")
    if selector is not None:
        check_kind("selector", selector, Selector)
    _check_list("callbacks", callbacks, Callback)
    _check_names(generator, energies, initializers)


def _check_names(generator: Generator, energies: Mapping[str, Any], initializers: Sequence[Initializer]) -> None:
    """Refuse priors on unknown variables, and variables that no initializer or several set."""
    for name, term in energies.items():
        if isinstance(term, Prior):
            check_names(f"energies.{name}.on", [term.on] if isinstance(term.on, str) else term.on, generator.variables)
    named = [name for initializer in initializers for name in initializer.on]
    check_names("initializers", named, generator.variables, complete=True)
    twice = sorted({name for name in named if named.count(name) > 1})
    if twice:
        raise ValueError(f"initializers: {', '.join(twice)} set by two initializers; each variable needs one")


def check_weights(energies: Mapping[str, Any], weights: Any, rank_weights: Any) -> None:
    """Refuse weights that are not a dict of numbers (or schedules, where accepted), and unknown names.

    Raises:
        TypeError, ValueError: naming the weight.
    """
    for name, given, check in (("weights", weights, _check_weight), ("rank_weights", rank_weights, check_range)):
        if given is not None:
            check_dict(name, given, check)
            check_names(name, given, energies)


def _check_weight(name: str, weight: Any) -> None:
    if not isinstance(weight, Schedule):
        check_range(name, weight)


def check_kind(name: str, value: Any, *kinds: type, remedy: str = "") -> None:
    """Refuse a value that is not an instance of one of these classes, such as the class itself.

    Raises:
        TypeError: naming the classes, the actual type, and the remedy.
    """
    if isinstance(value, kinds):
        return
    wanted = " or ".join(f"a kfit.core.{kind.__name__}" for kind in kinds)
    if isinstance(value, type) and not remedy:
        remedy = f"build it, {value.__name__}(…)"
    came = f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
    raise TypeError(f"{name} must be {wanted}, got {came}" + (f": {remedy}" if remedy else ""))


def check_observation(observation: Any) -> None:
    """Refuse anything but an observation.

    Raises:
        TypeError: naming the actual type.
    """
    remedy = "kfit.core.Observation(picture) makes one" if isinstance(observation, Tensor) else ""
    check_kind("observation", observation, Observation, remedy=remedy)


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
        terms: of the fit; variables of priors need not change the drawing.
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


def _check_list(name: str, values: Any, kind: type) -> None:
    if isinstance(values, kind):
        came = type(values).__name__
        raise TypeError(f"{name} must be a list of kfit.core.{kind.__name__}, got {came}: [{came}(…)]")
    if not isinstance(values, Sequence) or isinstance(values, str):
        raise TypeError(f"{name} must be a list of kfit.core.{kind.__name__}, got {type(values).__name__}")
    for number, value in enumerate(values):
        check_kind(f"{name}[{number}]", value, kind)
