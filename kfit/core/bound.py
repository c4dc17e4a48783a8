"""Generators with some of their variables held."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from torch import Tensor

from kfit.core.check import check_names, check_shape
from kfit.core.contracts import Generator
from kfit.core.state import Observation, Rendering
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
    check_bound(generator, fixed)
    bound = with_code(fixed["code"])
    rest = {name: value for name, value in fixed.items() if name != "code"}
    return bound.bind(**rest) if rest else bound


def check_bound(generator: Generator, fixed: Variables) -> None:
    """Refuse values to be held that are no variables of the generator, or of another shape than one value.

    Raises:
        TypeError, ValueError: naming the variable.
    """
    check_names("bind", fixed, generator.variables)
    for name, value in fixed.items():
        check_shape(f"bind: {name}", value, generator.variables[name].shape)


class Bound(Generator):
    """A generator with some variables held at one value for all rows."""

    def __init__(self, generator: Generator, fixed: Variables) -> None:
        super().__init__()
        check_bound(generator, fixed)
        self.generator, self.held = generator, tuple(fixed)
        self.variables = {k: v for k, v in generator.variables.items() if k not in fixed}
        for name, value in fixed.items():
            self.register_buffer(f"held_{name}", value.detach(), persistent=False)

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        return self.generator.prepare(observation)

    def forward(self, **values: Tensor) -> Rendering:
        rows = next(iter(values.values())).shape[0] if values else 1
        fixed = {name: self.get_buffer(f"held_{name}") for name in self.held}
        held = {k: v.expand(rows, *v.shape) for k, v in fixed.items()}
        rendering: Rendering = self.generator(**values, **held)
        return rendering
