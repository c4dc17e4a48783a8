"""A fit's parts written down, as recipes name them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kfit.core.part import Part, Unwritable


def recipe_of(name: str, value: Any) -> Any:
    """A part as ``{class_path, init_args}``, in which parts stand for themselves again; what is plain as it is.

    Args:
        name: of the argument, for the errors.
        value: a part, or what parts are built from.

    Raises:
        ValueError: for what text cannot hold, such as a network, and for classes that no import path finds.
    """
    if isinstance(value, Part):
        kind = type(value)
        if kind.__module__ == "__main__" or "<locals>" in kind.__qualname__:
            raise ValueError(f"{name}: {kind.__qualname__} can be imported from nowhere: move it to a file of its own")
        settings = {key: recipe_of(f"{name}.{key}", item) for key, item in value.settings.items()}
        path = f"{_home(kind)}.{kind.__qualname__}"
        return {"class_path": path, "init_args": settings} if settings else {"class_path": path}
    if isinstance(value, Mapping):
        return {key: recipe_of(f"{name}.{key}", item) for key, item in value.items()}
    if isinstance(value, list):
        return [recipe_of(f"{name}[{number}]", item) for number, item in enumerate(value)]
    if isinstance(value, Unwritable):
        raise ValueError(f"{name}: a recipe cannot hold {value.kind.__name__}, only text, numbers and parts")
    return value


def _home(kind: type) -> str:
    """The package that offers the class, as ``kfit.energies``, else its module."""
    from importlib import import_module

    package = kind.__module__.rpartition(".")[0]
    offered = package and getattr(import_module(package), kind.__name__, None) is kind
    return package if offered else kind.__module__
