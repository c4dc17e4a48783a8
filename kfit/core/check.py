"""Checks whose errors name the argument, the expected value and the actual one."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from numbers import Integral, Real
from os import PathLike
from typing import Any

from torch import Tensor


class FitError(RuntimeError):
    """Raised by a fit without an answer: every start of every problem became NaN or infinite.

    Example:
        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import Adam
        >>> template = Template(torch.full((1, 8, 8), torch.nan), "translation")
        >>> fit = kfit.FitPipeline(template, {"l2": L2()}, [Constant({"shift": 0.0})], Adam())
        >>> fit(kfit.Observation(torch.ones(1, 1, 8, 8)))
        Traceback (most recent call last):
        kfit.core.check.FitError: every start of every problem became NaN or infinite by step 0 of the fit
    """


def check_shape(name: str, value: Tensor, shape: tuple[int | str, ...]) -> None:
    """Refuse a tensor whose shape differs from ``shape``; letters match any size.

    Raises:
        TypeError: if ``value`` is not a tensor.
        ValueError: if the number of axes or a fixed size differs.
    """
    if not isinstance(value, Tensor):
        raise TypeError(f"{name} must be a tensor of shape {_spell(shape)}, got {type(value).__name__}")
    fits = value.dim() == len(shape) and all(
        isinstance(want, str) or want == have for want, have in zip(shape, value.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name} must have shape {_spell(shape)}, got {_spell(tuple(value.shape))}")


def check_float(name: str, value: Tensor) -> None:
    """Refuse a tensor that is not of floating point.

    Raises:
        TypeError: if ``value`` holds integers or booleans.
    """
    if not value.is_floating_point():
        raise TypeError(f"{name} must be a floating-point tensor, got {value.dtype}")


def check_range(name: str, value: Any, low: float = -math.inf, high: float = math.inf) -> None:
    """Refuse anything but a finite number in [low, high]; booleans do not count as numbers.

    Raises:
        TypeError: if it is not a number.
        ValueError: if it lies outside, is infinite or NaN.
    """
    _check_kind(name, value, Real, "a number")
    if not (low <= value <= high and _is_finite(value)):
        beyond = "be finite" if low == -math.inf else f"be finite and at least {low:g}"
        wanted = beyond if high == math.inf else f"lie between {low:g} and {high:g}"
        raise ValueError(f"{name} must {wanted}, got {_shown(value)}")


def check_positive(name: str, value: Any) -> None:
    """Refuse anything but a finite number above 0.

    Raises:
        TypeError: if it is not a number.
        ValueError: if it is not above 0, infinite or NaN.
    """
    _check_kind(name, value, Real, "a number")
    if not (value > 0 and _is_finite(value)):
        raise ValueError(f"{name} must be above 0 and finite, got {_shown(value)}")


def check_count(name: str, value: Any, least: int = 1, most: int | None = None) -> None:
    """Refuse anything but a whole number from ``least`` to ``most``; booleans and 2.0 are refused.

    Raises:
        TypeError: if it is not a whole number.
        ValueError: if it is too small or too large.
    """
    _check_kind(name, value, Integral, "a whole number")
    if value < least or (most is not None and value > most):
        wanted = f"be at least {least}" if most is None else f"lie between {least} and {most}"
        raise ValueError(f"{name} must {wanted}, got {_shown(value)}")


def check_choice(name: str, value: Any, choices: Iterable[str | bool]) -> None:
    """Refuse anything but one of the choices; with (False, True), 0 and 1 are refused.

    Raises:
        TypeError: if it has another type than the choices.
        ValueError: if it is not one of them.
    """
    choices = list(choices)
    if any(isinstance(value, type(choice)) and value == choice for choice in choices):
        return
    error = ValueError if isinstance(value, type(choices[0])) else TypeError
    words = " or ".join(map(repr, choices)) if len(choices) == 2 else f"one of {', '.join(map(str, choices))}"
    raise error(f"{name} must be {words}, got {_shown(value)}")


def check_text(name: str, value: Any) -> None:
    """Refuse anything but text or a path, without control characters.

    Raises:
        TypeError: if it is neither text nor a path.
        ValueError: if it holds control characters.
    """
    _check_kind(name, value, (str, PathLike), "text")
    if any(ord(character) < 32 for character in str(value)):
        raise ValueError(f"{name} must be text without control characters, got {_shown(value)}")


def check_list(name: str, values: Any, length: int | None, check: Callable[..., None], *bounds: Any) -> None:
    """Refuse anything but a list or tuple of ``length`` items (None: at least one), each accepted by ``check``.

    Raises:
        TypeError: if it is not a list, or by ``check``.
        ValueError: if it is empty or of another length, or by ``check``.
    """
    if isinstance(values, str | bytes):  # sequences too
        raise TypeError(f"{name} must be a list, got {_shown(values)}")
    _check_kind(name, values, Sequence, "a list")
    if len(values) != length if length is not None else not values:
        raise ValueError(
            f"{name} must hold {'at least one item' if length is None else f'{length} items'}, got {_shown(values)}"
        )
    for value in values:
        check(name, value, *bounds)


def check_dict(name: str, values: Any, check: Callable[..., None], *bounds: Any, keys: type = str) -> None:
    """Refuse anything but a dict with keys of type ``keys`` and values accepted by ``check``.

    Raises:
        TypeError: if it is not a dict, a key has another type, or by ``check``.
        ValueError: by ``check``.
    """
    _check_kind(name, values, Mapping, "a dict")
    for key, value in values.items():
        _check_kind(f"{name}: its keys", key, keys, f"of type {keys.__name__}")
        check(f"{name} of {_printable(key)}", value, *bounds)


def check_rising(name: str, pair: Any, low: float, high: float) -> None:
    """Refuse anything but two numbers in [low, high] of which the second is not below the first.

    Raises:
        TypeError: if it is not a list of numbers.
        ValueError: if there are not two, they decrease, or one lies outside.
    """
    check_list(name, pair, 2, check_range)
    if not low <= pair[0] <= pair[1] <= high:
        raise ValueError(f"{name} must rise within {low:g} to {high:g}, got {_shown(pair)}")


def check_names(name: str, names: Iterable[str], known: Collection[str], complete: bool = False) -> None:
    """Refuse unknown names and, if ``complete``, missing names.

    Raises:
        TypeError: if ``given`` does not hold names.
        ValueError: listing the names that exist.
    """
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise TypeError(f"{name} must hold names, got {_shown(names)}")
    names = list(names)
    if strange := [item for item in names if not isinstance(item, str)]:
        raise TypeError(f"{name} must hold names, got {_shown(strange[0])}")
    unknown = sorted(set(names) - set(known))
    missing = sorted(set(known) - set(names)) if complete else []
    if unknown or missing:
        reason = f"unknown {', '.join(map(_printable, unknown))}" if unknown else f"nothing for {', '.join(missing)}"
        raise ValueError(f"{name}: {reason}; the names are {', '.join(sorted(known))}")


def check_bound(variables: Mapping[str, Any], fixed: Mapping[str, Tensor]) -> None:
    """Refuse fixed values whose name is not a variable of a generator, or whose shape differs from one value's.

    Raises:
        TypeError, ValueError: naming the variable.
    """
    check_names("bind", fixed, variables)
    for name, value in fixed.items():
        check_shape(f"bind: {name}", value, variables[name].shape)


def _check_kind(name: str, value: Any, kind: Any, words: str) -> None:
    if isinstance(value, bool) or not isinstance(value, kind):
        raise TypeError(f"{name} must be {words}, got {_shown(value)}")


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond floats
        return False


def _shown(value: Any) -> str:
    """Return a short repr on one line."""
    return " ".join(reprlib.repr(value).split())


def _printable(name: object) -> str:
    """Return a name as it is, or as Python's literal where it would break the line."""
    return str(name) if str(name).isprintable() else repr(name)


def _spell(shape: tuple[int | str, ...]) -> str:
    return "(" + ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
