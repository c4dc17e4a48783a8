"""Parts that store the arguments they were built with, so that they can be shown and written to recipes."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import PurePath
from typing import Any

from torch import nn


class Part:
    """Base of the parts of a fit: stores the arguments of its constructor.

    The stored arguments are those of the object's own class. Subclasses need no additional code.

    Attributes:
        settings: arguments that differ from their defaults, by name. Networks, tensors and other values that text
            cannot hold are replaced by an `Unwritable`, so that nothing large is kept.
    """

    settings: Mapping[str, Any] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in vars(cls):
            cls.__init__ = _remembering(cls.__init__)  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return (
            nn.Module.__repr__(self) if isinstance(self, nn.Module) else f"{type(self).__name__}({self.extra_repr()})"
        )

    def extra_repr(self) -> str:
        """Return all settings as in a call of the constructor; a module omits those that are its submodules."""
        parameters = inspect.signature(type(self)).parameters.values()
        known = {p.name: self.settings.get(p.name, p.default) for p in parameters if p.kind is not p.VAR_KEYWORD}
        if isinstance(self, nn.Module):
            shown = {name: value for name, value in known.items() if not isinstance(value, nn.Module)}
        else:  # modules of other parts have a long repr
            shown = {n: Unwritable(type(v)) if isinstance(v, nn.Module) else v for n, v in known.items()}
        return ", ".join(f"{name}={value!r}" for name, value in shown.items() if value is not inspect.Parameter.empty)


class Unwritable:
    """Placeholder of an argument that text cannot hold, such as a network.

    Args:
        kind: type of the argument.
    """

    def __init__(self, kind: type) -> None:
        self.kind = kind

    def __repr__(self) -> str:
        return f"<{self.kind.__name__}>"


def _remembering(init: Callable[..., None]) -> Callable[..., None]:
    @functools.wraps(init)
    def remembering(self: Any, *args: Any, **kwargs: Any) -> None:
        if "settings" not in vars(self):  # already set if a subclass calls its base's constructor
            with suppress(TypeError):  # wrong arguments are refused by the constructor itself
                signature = inspect.signature(init)
                values = {k: _written(v) for k, v in signature.bind(self, *args, **kwargs).arguments.items()}
                del values[next(iter(values))]
                defaults = {name: _written(parameter.default) for name, parameter in signature.parameters.items()}
                vars(self)["settings"] = {name: value for name, value in values.items() if value != defaults[name]}
        init(self, *args, **kwargs)

    return remembering


def _written(value: Any) -> Any:
    """Convert a value to types of YAML; parts are kept."""
    if value is None or isinstance(value, bool | int | str | Part):
        return value
    if isinstance(value, float):
        return float(value)  # NumPy's too
    if isinstance(value, type) and "<locals>" not in value.__qualname__:
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, Mapping):
        return {key: _written(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_written(item) for item in value]
    return Unwritable(type(value))
