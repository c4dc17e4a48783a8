"""A fit as YAML, in the form of recipes."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from torch import nn

from kfit.core import Initializer
from kfit.core.part import Part, Unwritable
from kfit.initializers import EncoderPosterior
from kfit.selectors import LowestEnergy


def recipe_text(pipeline: nn.Module) -> str:
    """Return the YAML of a `kfit.FitPipeline` without its generator, limited to settings that are not defaults.

    An `EncoderPosterior` of a code with default settings is omitted: if no initializer sets the code, readers of a
    recipe use the encoder of the model.
    """
    import yaml  # type: ignore[import-untyped]

    parameters = inspect.signature(type(pipeline)).parameters.values()
    settings = {p.name: getattr(pipeline, p.name) for p in parameters if p.name != "generator"}
    settings["energies"] = dict(settings["energies"].items())
    settings["initializers"] = [one for one in settings["initializers"] if not _of_model(one)]
    settings["callbacks"] = list(settings["callbacks"])
    defaults = {p.name: p.default for p in parameters}
    defaults |= {"callbacks": [], "num_candidates": settings["num_starts"]}
    defaults |= {"weights": dict.fromkeys(settings["energies"], 1.0)}
    if type(settings["selector"]) is LowestEnergy:
        defaults["selector"] = settings["selector"]
    written = {n: recipe_of(n, part) for n, part in settings.items() if part is not defaults[n] and part != defaults[n]}
    text: str = yaml.safe_dump(written, sort_keys=False, allow_unicode=True)
    return text


def _of_model(initializer: Initializer) -> bool:
    return type(initializer) is EncoderPosterior and initializer.on == ("code",) and initializer.sigma == 1


def recipe_of(name: str, value: Any) -> Any:
    """Convert a part to ``{class_path, init_args}``, recursively; plain values are returned unchanged.

    Args:
        name: name of the argument, for errors.
        value: a part, or an argument of a part.

    Raises:
        ValueError: if text cannot hold the value, such as a network, or a class cannot be imported.
    """
    if isinstance(value, Part):
        kind = type(value)
        if kind.__module__ == "__main__" or "<locals>" in kind.__qualname__:
            raise ValueError(f"{name}: {kind.__qualname__} cannot be imported: move it to its own file")
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
    """Return the package that exports the class, such as ``kfit.energies``, else its module."""
    package = kind.__module__.rpartition(".")[0]
    offered = package and getattr(import_module(package), kind.__name__, None) is kind
    return package if offered else kind.__module__
