"""The contracts: read this file and you know the design.

A *generator* draws a picture from named variables. An *energy* says how badly the picture explains an observation.
*Initializers* propose starts, an *optimizer* moves them, a *selector* picks the winner, *callbacks* look on; a
`kfit.FitPipeline` holds them together. A fit holds N **rows**, each one start of one problem; problems may differ in
how many they have.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol, TypeAlias

import torch
from torch import Tensor, nn

from kfit.core.check import check_bound
from kfit.core.part import Part
from kfit.core.pictures import Reduction, at_least_single, check_prediction, check_target, precision_of, reduced
from kfit.core.result import FitResult
from kfit.core.state import Evaluation, FitState, Observation, Rendering
from kfit.core.variables import Variable, Variables

Need = Literal["value", "gradient", "residuals", "pictures"]
Step: TypeAlias = "tuple[Variables, Evaluation, Any]"


class Generator(Part, nn.Module, ABC):
    """Draws pictures from named variables.

    Attributes:
        variables: what it can be asked to explain, by name.
    """

    variables: Mapping[str, Variable]

    @abstractmethod
    def forward(self, **values: Tensor) -> Rendering:
        """Draw N pictures; each value is (N, \\*shape), all rows independent of one another."""

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        """What the generator needs to know of the pictures besides its variables, such as their cameras.

        Made once a fit; each tensor leads with the B problems and is given to `forward` by its name, a row for each
        row drawn. A generator of several views draws the V pictures of a row one after another, (N · V, …).
        """
        return {}

    def bind(self, **fixed: Tensor) -> Generator:
        """The same generator with some variables held at one value (\\*shape) for all rows.

        A generator for which holding a variable saves work overrides this. With all variables held it draws one row.

        Raises:
            ValueError: for a name that is no variable of this generator, or a value of another shape.
        """
        return Bound(self, fixed)


class Bound(Generator):
    """A generator with some variables held at one value for all rows."""

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
        fixed = {name: self.get_buffer(f"held_{name}") for name in self.held}
        held = {k: v.expand(rows, *v.shape) for k, v in fixed.items()}
        rendering: Rendering = self.generator(**values, **held)
        return rendering


class Encoder(nn.Module, ABC):
    """Looks at pictures and says which codes could have drawn them."""

    @abstractmethod
    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance (N, D) of a Gaussian over the code, from RGB (N, 3, S, S) in [0, 1] on white."""


class Energy(Part, nn.Module, ABC):
    """How badly a prediction explains a target: one number a row, lower is better.

    Compares two tensors, so it serves any task and needs no pipeline.

    Attributes:
        on: field(s) of rendering and observation that a pipeline hands it; a tuple hands dicts of tensors.
        mixed: whether a fit under ``torch.autocast`` should compare under it too, as convolutions of many channels
            gain by it. Others lose in half precision what they measure, and are kept out of it.
        volumes: whether it compares volumes (N, C, D, H, W) too.
        unit_range: whether its numbers mean something for targets in [0, 1] alone.
    """

    on: str | tuple[str, ...] = "image"
    mixed: bool = False
    volumes: bool = False
    unit_range: bool = False

    def check(self, target: Any, weight: Tensor | None = None) -> None:
        """Refuse, with TypeError or ValueError, what it cannot compare; done once a fit, and in each `forward`."""
        check_target(target, weight, self.volumes, self.unit_range)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        """What of the target can be computed once a fit: a pytree of tensors that lead with rows.

        Args:
            target: (N, C, H, W), or a dict of such where ``on`` is a tuple.
            weight: (N, 1, H, W) or None, 0 where a pixel does not count, be it NaN. In a fit it is the product of the
                observation's weight and the rendering's.
        """
        return {"target": target} if weight is None else {"target": target, "weight": weight}

    @abstractmethod
    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        """Energies (N,) of N predictions against N prepared targets."""

    def forward(
        self, prediction: Any, target: Any, weight: Tensor | None = None, reduction: Reduction = "none"
    ) -> Tensor:
        """``compare(prediction, prepare(target, weight))``, checked, for other tasks such as trainings.

        Under ``torch.autocast`` it computes in single precision, unless it is ``mixed``. ``reduction`` "none" gives
        energies (N,), "mean" and "sum" one number.
        """
        self.check(target, weight)
        check_prediction(prediction, target, self.volumes)
        prediction, target = at_least_single((prediction, target))
        with precision_of(target, self.mixed):
            return reduced(self.compare(prediction, self.prepare(target, weight)), reduction)


class ResidualEnergy(Energy):
    """An energy that is a mean of squares: E = Σ_m r_m²."""

    @abstractmethod
    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        """Residuals (N, M) whose squares sum to the energy."""

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        return self.residuals(prediction, prepared).square().sum(1)


class Prior(Part, nn.Module, ABC):
    """How unlikely values of variables are, in general or for the picture that was seen: one number a row.

    Attributes:
        on: the variable's name; a tuple of names is handed a dict.
    """

    on: str | tuple[str, ...]

    def prepare(self, observation: Observation) -> Any:
        """What the picture says of them, made once a fit: tensors that lead with rows, or None."""
        return None

    @abstractmethod
    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        """Energies (N,) of N values (N, \\*shape); handed what `prepare` made where that is not None."""


class ResidualPrior(Prior):
    """A prior that is a sum of squares: E = Σ_m r_m²."""

    @abstractmethod
    def residuals(self, value: Any, prepared: Any = None) -> Tensor:
        """Residuals (N, M) whose squares sum to the energy."""

    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        return self.residuals(value, prepared).square().sum(1)


class Initializer(Part, ABC):
    """Proposes starts.

    Attributes:
        on: names of the variables that it sets together.
    """

    on: tuple[str, ...]

    @abstractmethod
    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        """Values (B·S, \\*shape) for its variables, the S starts of a problem one after another.

        Args:
            variables: those of the generator.
            observation: B problems.
            num_starts: S.
            rngs: one generator of random numbers (on the CPU) a problem.
        """


class Evaluate(Protocol):
    """Draws rows and compares them: any number of rows, each with the problem that it belongs to.

    Only ``need="gradient"`` builds a graph; residuals can be had where all descended terms are sums of squares;
    ``need="pictures"`` gives the observed pictures too.
    """

    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Evaluate rows (N, \\*raw_shape); the gradient is by a step from ``raw``, as `retract` takes it."""
        ...

    def retract(self, raw: Variables, step: Variables) -> Variables:
        """Raw variables after a step, each in its variable's space; ``raw + step`` where that is flat."""
        ...

    def linearize(self, raw: Variables, problem: Tensor) -> Linearization:
        """Draw rows once and keep the graph, for products with their residuals' Jacobian."""
        ...


class Linearization(Protocol):
    """Residuals r (N, M) near ``raw`` as a linear map of a step, J = ∂r/∂step, without ever holding J."""

    def push(self, step: Tensor) -> Tensor:
        """J · step, (N, M), for steps (N, P) of all variables laid end to end."""
        ...

    def pull(self, residuals: Tensor) -> Tensor:
        """Jᵀ · residuals, (N, P), for (N, M)."""
        ...


class Optimizer(Part, ABC):
    """Moves rows downhill. Stateless: its memory is a value in which every tensor leads with rows."""

    @property
    def networks(self) -> list[nn.Module]:
        """Networks that it holds, which a pipeline moves to its device."""
        return [value for value in vars(self).values() if isinstance(value, nn.Module)]

    @abstractmethod
    def init(self, raw: Variables, seeds: Tensor) -> Any:
        """Memory for these rows.

        Args:
            raw: (N, \\*shape) each.
            seeds: (N,) whole numbers that decide each row's random numbers, whatever rows are beside it.

        Raises ValueError if its settings name unknown variables.
        """

    @abstractmethod
    def step(self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any) -> Step:
        """One step: the new raw variables, the evaluation *at the old ones*, and the new memory."""


class Callback(Part):
    """Looks on during a fit, and may thin the rows out."""

    def on_start(self, state: FitState) -> None:
        """Called once, before the first step."""

    def on_step(self, state: FitState) -> FitState:
        """Called after each evaluation; what it returns goes on."""
        return state

    def on_end(self, result: FitResult) -> None:
        """Called once, with the result."""


class Selector(Part, ABC):
    """Picks the winner of each problem."""

    @abstractmethod
    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        """Row (B,) that wins each problem, from R rows in any order; every problem 0…B−1 has at least one row."""


class Schedule(Part, ABC):
    """A term's weight that changes over the steps."""

    @abstractmethod
    def __call__(self, step: int, num_steps: int) -> float:
        """Weight at ``step`` (0 … num_steps)."""
