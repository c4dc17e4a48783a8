"""The contract of what draws pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from torch import Tensor, nn

from kfit.core.check import check_bound
from kfit.core.observation import Observation, Rendering
from kfit.core.part import Part
from kfit.core.variables import Variable, Variables


class Generator(Part, nn.Module, ABC):
    """Draws pictures from named variables.

    Attributes:
        variables: the inputs that a fit can find, by name.

    Example:
        >>> import torch, kfit
        >>> class Grey(kfit.Generator):
        ...     variables = {"level": kfit.Variable()}
        ...
        ...     def forward(self, level: torch.Tensor) -> kfit.Rendering:
        ...         return kfit.Rendering(level.view(-1, 1, 1, 1).expand(-1, 3, 8, 8))
        >>> Grey()(level=torch.tensor([0.2, 0.7])).image.shape
        torch.Size([2, 3, 8, 8])
    """

    variables: Mapping[str, Variable]
    __call__: Callable[..., Rendering]

    @abstractmethod
    def forward(self, *args: Any, **values: Any) -> Rendering:
        """Draw N pictures from values (N, \\*shape) by name, all rows independent of one another.

        A subclass may name its variables: ``def forward(self, code: Tensor, angle: Tensor) -> Rendering``.
        """

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        """Return what the generator needs of the pictures besides its variables, such as their cameras.

        Called once a fit. Each tensor leads with the B problems and is passed to ``forward`` by its name, a row for
        each row drawn. A generator of several views draws the V pictures of a row consecutively, (N · V, …).
        """
        return {}

    def bind(self, **fixed: Tensor) -> Generator:
        """Return this generator with some variables fixed at one value (\\*shape) for all rows.

        Generators that save work for fixed variables override this. With all variables fixed it draws one row.

        Raises:
            ValueError: if a name is not a variable of this generator, or a value has another shape.
        """
        return Bound(self, fixed)


class Bound(Generator):
    """A generator with some variables fixed at one value for all rows."""

    def __init__(self, generator: Generator, fixed: Variables) -> None:
        super().__init__()
        check_bound(generator.variables, fixed)
        self.generator, self.held = generator, tuple(fixed)
        self.variables = {k: v for k, v in generator.variables.items() if k not in fixed}
        for name, value in fixed.items():
            self.register_buffer(f"held_{name}", value.detach(), persistent=False)

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        return self.generator.prepare(observation)

    def forward(self, **values: Tensor) -> Rendering:
        rows = next(iter(values.values())).shape[0] if values else 1
        held = {name: self.get_buffer(f"held_{name}") for name in self.held}
        return self.generator(**values, **{k: v.expand(rows, *v.shape) for k, v in held.items()})
