"""Checks whose errors name the argument, what was expected and what came."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from torch import Tensor


class FitError(RuntimeError):
    """A fit that cannot give an answer: every start of every problem became NaN or infinite."""


def check_shape(name: str, value: Tensor, shape: tuple[int | str, ...]) -> None:
    """Refuse a tensor whose shape differs from ``shape``; letters stand for any size.

    Raises:
        TypeError: if ``value`` is no tensor.
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


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Refuse a number outside [low, high].

    Raises:
        ValueError: if it lies outside or is NaN.
    """
    if not low <= value <= high:
        raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {value!r}")


def check_names(name: str, given: Iterable[str], known: Collection[str], complete: bool = False) -> None:
    """Refuse names that do not exist and, where ``complete``, names that are missing.

    Raises:
        ValueError: listing the names that exist.
    """
    given = list(given)
    unknown = sorted(set(given) - set(known))
    missing = sorted(set(known) - set(given)) if complete else []
    if unknown or missing:
        said = f"unknown {', '.join(unknown)}" if unknown else f"nothing for {', '.join(missing)}"
        raise ValueError(f"{name}: {said}; the names are {', '.join(sorted(known))}")


def _spell(shape: tuple[int | str, ...]) -> str:
    return "(" + ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
