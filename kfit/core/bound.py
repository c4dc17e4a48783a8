"""Binding the code of a generator that then computes a part of its work once."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from kfit.core.check import check_bound
from kfit.core.generator import Generator
from kfit.core.variables import Variables


def bind_code(generator: Generator, fixed: Variables, with_code: Callable[[Tensor], Generator]) -> Generator:
    """Implement `Generator.bind` for a generator that saves work if its ``code`` is fixed.

    Args:
        generator: the generator to bind.
        fixed: values by name.
        with_code: returns the generator that draws with this code.

    Raises:
        ValueError: if a name is not a variable of the generator, or a value has another shape.
    """
    if "code" not in fixed:
        return Generator.bind(generator, **fixed)
    check_bound(generator.variables, fixed)
    bound = with_code(fixed["code"])
    others = {name: value for name, value in fixed.items() if name != "code"}
    return bound.bind(**others) if others else bound
