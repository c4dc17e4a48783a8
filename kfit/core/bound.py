"""Holding the code of a generator that does part of its work for a code once."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from kfit.core.check import check_bound
from kfit.core.contracts import Generator
from kfit.core.variables import Variables


def bind_code(generator: Generator, fixed: Variables, with_code: Callable[[Tensor], Generator]) -> Generator:
    """`Generator.bind` for a generator of which a held ``code`` saves work.

    Args:
        generator: whose variables are held.
        fixed: values by name.
        with_code: the generator that draws with this code held.

    Raises:
        ValueError: for a name that is no variable of the generator, or a value of another shape.
    """
    if "code" not in fixed:
        return Generator.bind(generator, **fixed)
    check_bound(generator.variables, fixed)
    bound = with_code(fixed["code"])
    rest = {name: value for name, value in fixed.items() if name != "code"}
    return bound.bind(**rest) if rest else bound
