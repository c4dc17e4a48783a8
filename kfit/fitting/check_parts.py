"""Checks of the parts of a fit: each error names the part and the remedy in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from kfit.core import Callback, Energy, Generator, Initializer, Observation, Optimizer, Prior, Schedule, Selector
from kfit.core.check import check_dict, check_names, check_range


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
        if isinstance(term, Energy) and type(term).forward is not Energy.forward:
            raise TypeError(
                f"energies.{name}: {type(term).__name__} has a `forward` of its own, which a fit does not call: define "
                "`compare` (and `prepare`)"
            )
    _check_list("initializers", initializers, Initializer)
    foreign = torch.optim.Optimizer
    remedy = "kfit.optimizers.TorchOptimizer wraps classes of torch.optim"
    torchs = isinstance(optimizer, foreign) or (isinstance(optimizer, type) and issubclass(optimizer, foreign))
    check_kind("optimizer", optimizer, Optimizer, remedy=remedy if torchs else "")
    if selector is not None:
        check_kind("selector", selector, Selector)
    check_callbacks(callbacks)
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


def check_candidates(num_candidates: int | None, num_starts: int) -> None:
    """Refuse fewer candidates than starts, which are chosen among them.

    Raises:
        ValueError: naming both numbers.
    """
    if num_candidates is not None and num_candidates < num_starts:
        raise ValueError(f"num_candidates must be at least num_starts, {num_starts}, got {num_candidates}")


def check_weights(energies: Mapping[str, Any], weights: Any, rank_weights: Any) -> None:
    """Refuse weights that are not a dict of numbers (or schedules, where accepted), and unknown names.

    Raises:
        TypeError, ValueError: naming the weight.
    """
    for name, values, check in (("weights", weights, _check_weight), ("rank_weights", rank_weights, check_range)):
        if values is not None:
            check_dict(name, values, check)
            check_names(name, values, energies)


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
    """Refuse anything but an observation of at least one problem.

    Raises:
        TypeError: naming the actual type.
        ValueError: if it has no picture.
    """
    remedy = "kfit.core.Observation(picture) makes one" if isinstance(observation, Tensor) else ""
    check_kind("observation", observation, Observation, remedy=remedy)
    if observation.num_problems == 0:
        raise ValueError("observation must hold at least one picture, got none")


def check_callbacks(callbacks: Any) -> None:
    """Refuse anything but a list of callbacks.

    Raises:
        TypeError: Names the first entry that is not a callback.
    """
    _check_list("callbacks", callbacks, Callback)


def _check_list(name: str, values: Any, kind: type) -> None:
    if isinstance(values, kind):
        came = type(values).__name__
        raise TypeError(f"{name} must be a list of kfit.core.{kind.__name__}, got {came}: [{came}(…)]")
    if not isinstance(values, Sequence) or isinstance(values, str):
        raise TypeError(f"{name} must be a list of kfit.core.{kind.__name__}, got {type(values).__name__}")
    for number, value in enumerate(values):
        check_kind(f"{name}[{number}]", value, kind)
