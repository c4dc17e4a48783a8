"""A check of all scalar arguments of a class or function, by the types in its signature."""

from __future__ import annotations

import functools
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from kfit.core.check import check_choice, check_count, check_dict, check_list, check_range, check_text


def check_arguments(owner: Callable[..., Any], values: Mapping[str, Any], **bounds: tuple[Any, ...]) -> None:
    """Refuse scalar arguments, and lists and dicts of them, that are not of the types in a signature.

    Whole numbers are at least 1 unless bounds say otherwise, numbers are finite, text has no control characters, lists
    are not empty. ``None`` is accepted where the signature has it. Tensors, networks and other parts are not checked.

    Example:
        >>> from kfit.core.arguments import check_arguments
        >>> def blur(sigma: float, num_times: int = 1) -> None:
        ...     check_arguments(blur, locals(), sigma=(0, 8))
        >>> blur(9.0)
        Traceback (most recent call last):
        ValueError: blur: sigma must lie between 0 and 8, got 9.0

    Args:
        owner: the class or function, which errors name.
        values: arguments by name, such as ``locals()`` at the start of a constructor; others are ignored.
        bounds: by argument, lowest and highest number (also of a list's items), or a check of
            `kfit.core.check` followed by its bounds.

    Raises:
        TypeError, ValueError: naming the class or function and the argument.
    """
    for name, hint in _hints(owner).items():
        if name in values:
            _check(f"{owner.__name__}: {name}", values[name], hint, bounds.get(name, ()))


@functools.cache
def _hints(owner: Callable[..., Any]) -> dict[str, Any]:
    hints = typing.get_type_hints(owner.__init__ if isinstance(owner, type) else owner)  # type: ignore[misc]
    return {name: hint for name, hint in hints.items() if name != "return" and _is_plain(hint)}


def _is_plain(hint: Any) -> bool:
    """Whether a type is that of numbers, switches, words, or lists and dicts of these."""
    if get_origin(hint) is Literal:
        return True
    if parts := [part for part in get_args(hint) if part is not Ellipsis]:
        return all(map(_is_plain, parts)) and (get_origin(hint) is not tuple or len(set(parts)) == 1)
    return hint in (int, float, bool, str, Path, type(None))


def _check(name: str, value: Any, hint: Any, bounds: tuple[Any, ...]) -> None:
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in parts:
            return
        hint = _meant(value, [part for part in parts if part is not type(None)])
        origin, parts = get_origin(hint), get_args(hint)
    if bounds and callable(bounds[0]):
        bounds[0](name, value, *bounds[1:])
    elif origin is Literal:
        check_choice(name, value, parts)
    elif origin is not None and issubclass(origin, Mapping):
        check_dict(name, value, _check, parts[1], bounds, keys=parts[0])
    elif origin is not None:
        length = len(parts) if origin is tuple and Ellipsis not in parts else None
        check_list(name, value, length, _check, parts[0], bounds)
    elif hint is bool:
        check_choice(name, value, (False, True))
    elif hint is int:
        check_count(name, value, *bounds)
    elif hint is float:
        check_range(name, value, *bounds)
    else:
        check_text(name, value)


def _meant(value: Any, hints: list[Any]) -> Any:
    """The alternative that a value seems to be meant as: dicts, lists and switches by their kind, else the first."""
    kind = Mapping if isinstance(value, Mapping) else Sequence if isinstance(value, list | tuple) else None
    for hint in hints:
        origin = get_origin(hint)
        if kind is not None and isinstance(origin, type) and issubclass(origin, kind):
            return hint
    others = [hint for hint in hints if hint is not bool]
    return bool if bool in hints and (isinstance(value, bool) or not others) else others[0]
