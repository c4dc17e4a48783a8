"""The contracts: read this file and you know the design.

A *generator* draws a picture from named variables. An *energy* measures how badly the picture explains an observation.
*Initializers* set initial values, an *optimizer* moves them, a *selector* picks the winner, *callbacks* observe; a
`kfit.FitPipeline` holds them together. A fit has N **rows**, each one start of one problem; problems may have
different numbers of rows.
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

    @abstractmethod
    def forward(self, **values: Tensor) -> Rendering:
        """Draw N pictures; each value is (N, \\*shape), all rows independent of one another."""

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        """Return what the generator needs of the pictures besides its variables, such as their cameras.

        Called once a fit. Each tensor leads with the B problems and is passed to `forward` by its name, a row for each
        row drawn. A generator of several views draws the V pictures of a row consecutively, (N · V, …).
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
        fixed = {name: self.get_buffer(f"held_{name}") for name in self.held}
        held = {k: v.expand(rows, *v.shape) for k, v in fixed.items()}
        rendering: Rendering = self.generator(**values, **held)
        return rendering


class Encoder(nn.Module, ABC):
    """Predicts which codes could have drawn a picture.

    Example:
        >>> import torch
        >>> from kfit.generators import ConvEncoder
        >>> mean, log_variance = ConvEncoder(code_dim=8)(torch.rand(2, 3, 64, 64))
        >>> mean.shape
        torch.Size([2, 8])
    """

    @abstractmethod
    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and log-variance (N, D) of a Gaussian over the code, from RGB (N, 3, S, S) in [0, 1] on white."""


class Energy(Part, nn.Module, ABC):
    """Measures how badly a prediction explains a target: one number a row, lower is better.

    It compares two tensors, so it serves any task and needs no pipeline.

    Attributes:
        on: field(s) of rendering and observation that a pipeline passes; with a tuple it passes dicts of tensors.
        mixed: whether it is evaluated under ``torch.autocast`` in a fit under autocast, which speeds up convolutions of
            many channels. Other energies would lose precision, and are evaluated without autocast.
        volumes: whether it compares volumes (N, C, D, H, W) too.
        unit_range: whether it is meaningful for targets in [0, 1] alone.

    Example:
        >>> import torch, kfit
        >>> class Brightness(kfit.Energy):
        ...     def compare(self, prediction: torch.Tensor, prepared: dict) -> torch.Tensor:
        ...         return (prediction - prepared["target"]).mean((1, 2, 3)).abs()
        >>> Brightness()(torch.zeros(2, 3, 8, 8), torch.full((2, 3, 8, 8), 0.25))
        tensor([0.2500, 0.2500])
    """

    on: str | tuple[str, ...] = "image"
    mixed: bool = False
    volumes: bool = False
    unit_range: bool = False

    def check(self, target: Any, weight: Tensor | None = None) -> None:
        """Refuse, with TypeError or ValueError, targets it cannot compare; called once a fit, and in each `forward`."""
        check_target(target, weight, self.volumes, self.unit_range)

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        """Compute what depends on the target alone, once a fit: a pytree of tensors that lead with rows.

        Args:
            target: (N, C, H, W), or a dict of such if ``on`` is a tuple.
            weight: (N, 1, H, W) or None; 0 excludes a pixel, even if it is NaN. In a fit it is the product of the
                observation's weight and the rendering's.
        """
        return {"target": target} if weight is None else {"target": target, "weight": weight}

    @abstractmethod
    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        """Return energies (N,) of N predictions and N prepared targets."""

    def forward(
        self, prediction: Any, target: Any, weight: Tensor | None = None, reduction: Reduction = "none"
    ) -> Tensor:
        """Return ``compare(prediction, prepare(target, weight))`` of checked inputs, for other tasks such as training.

        Under ``torch.autocast`` it computes in single precision, unless it is ``mixed``. ``reduction`` "none" returns
        energies (N,), "mean" and "sum" one number.
        """
        self.check(target, weight)
        check_prediction(prediction, target, self.volumes)
        prediction, target = at_least_single((prediction, target))
        with precision_of(target, self.mixed):
            return reduced(self.compare(prediction, self.prepare(target, weight)), reduction)


class ResidualEnergy(Energy):
    """An energy that is a mean of squares: E = Σ_m r_m².

    Example:
        >>> import torch, kfit
        >>> class MeanSquare(kfit.ResidualEnergy):
        ...     def residuals(self, prediction: torch.Tensor, prepared: dict) -> torch.Tensor:
        ...         difference = (prediction - prepared["target"]).flatten(1)
        ...         return difference / difference.shape[1] ** 0.5
        >>> MeanSquare()(torch.zeros(1, 3, 8, 8), torch.full((1, 3, 8, 8), 0.5))
        tensor([0.2500])
    """

    @abstractmethod
    def residuals(self, prediction: Any, prepared: Any) -> Tensor:
        """Return residuals (N, M) whose squares sum to the energy."""

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        return self.residuals(prediction, prepared).square().sum(1)


class Prior(Part, nn.Module, ABC):
    """Measures how unlikely values of variables are, in general or for the observed picture: one number a row.

    Attributes:
        on: name of the variable; with a tuple of names it takes a dict.

    Example:
        >>> import torch, kfit
        >>> class Upright(kfit.Prior):
        ...     on = "roll"
        ...
        ...     def forward(self, value: torch.Tensor, prepared: None = None) -> torch.Tensor:
        ...         return 1 - value.cos()
        >>> Upright()(torch.tensor([0.0, 3.1416]))
        tensor([0., 2.])
    """

    on: str | tuple[str, ...]

    def prepare(self, observation: Observation) -> Any:
        """Compute what depends on the picture alone, once a fit: tensors that lead with rows, or None."""
        return None

    @abstractmethod
    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        """Return energies (N,) of N values (N, \\*shape), with the result of `prepare` if it is not None."""


class ResidualPrior(Prior):
    """A prior that is a sum of squares: E = Σ_m r_m².

    Example:
        >>> import torch, kfit
        >>> class Small(kfit.ResidualPrior):
        ...     on = "shift"
        ...
        ...     def residuals(self, value: torch.Tensor, prepared: None = None) -> torch.Tensor:
        ...         return value
        >>> Small()(torch.tensor([[3.0, 4.0]]))
        tensor([25.])
    """

    @abstractmethod
    def residuals(self, value: Any, prepared: Any = None) -> Tensor:
        """Return residuals (N, M) whose squares sum to the energy."""

    def forward(self, value: Any, prepared: Any = None) -> Tensor:
        return self.residuals(value, prepared).square().sum(1)


class Initializer(Part, ABC):
    """Sets the initial values of some variables.

    Attributes:
        on: names of the variables that it sets together.

    Example:
        >>> import torch, kfit
        >>> class Dark(kfit.Initializer):
        ...     on = ("level",)
        ...
        ...     def __call__(self, variables, observation, num_starts, rngs):
        ...         noise = [0.1 * torch.rand(num_starts, generator=rng) for rng in rngs]
        ...         return {"level": torch.cat(noise)}
        >>> observation = kfit.Observation(torch.ones(2, 3, 8, 8))
        >>> Dark()({"level": kfit.Variable()}, observation, 5, [torch.Generator() for _ in range(2)])["level"].shape
        torch.Size([10])
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
        """Return values (B·S, \\*shape) of its variables, the S starts of a problem consecutively.

        Args:
            variables: those of the generator.
            observation: B problems.
            num_starts: S.
            rngs: one generator of random numbers (on the CPU) for each problem.
        """


class Evaluate(Protocol):
    """Draws rows and compares them: any number of rows, each with the number of its problem.

    Only ``need="gradient"`` builds a graph. Residuals need all minimised terms to be sums of squares.
    ``need="pictures"`` returns the observed pictures of the rows too.
    """

    def __call__(self, raw: Variables, problem: Tensor, need: Need = "value") -> Evaluation:
        """Evaluate rows (N, \\*raw_shape); the gradient is with respect to a step as `retract` takes it."""
        ...

    def retract(self, raw: Variables, step: Variables) -> Variables:
        """Return raw variables after a step, each in its variable's space; ``raw + step`` in flat spaces."""
        ...

    def linearize(self, raw: Variables, problem: Tensor) -> Linearization:
        """Draw rows once and keep the graph, for products with the Jacobian of their residuals."""
        ...


class Linearization(Protocol):
    """Residuals r (N, M) near ``raw`` as a linear map of a step, J = ∂r/∂step, without storing J."""

    def push(self, step: Tensor) -> Tensor:
        """Return J · step, (N, M), for steps (N, P) of all variables, concatenated."""
        ...

    def pull(self, residuals: Tensor) -> Tensor:
        """Return Jᵀ · residuals, (N, P), for (N, M)."""
        ...


class Optimizer(Part, ABC):
    """Moves rows downhill. Stateless: its memory is a value in which every tensor leads with rows.

    Example:
        >>> import torch, kfit
        >>> class GradientDescent(kfit.Optimizer):
        ...     def init(self, raw, seeds):
        ...         return None
        ...
        ...     def step(self, evaluate, raw, problem, memory):
        ...         evaluation = evaluate(raw, problem, need="gradient")
        ...         step = {name: -0.1 * slope for name, slope in evaluation.gradient.items()}
        ...         return evaluate.retract(raw, step), evaluation, memory
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> template, start = Template(torch.rand(1, 8, 8), "translation"), [Constant({"shift": 0.0})]
        >>> fit = kfit.FitPipeline(template, {"l2": L2()}, start, GradientDescent(), num_starts=1)
        >>> fit(kfit.Observation(torch.rand(1, 1, 8, 8))).num_evaluations  # 50 steps, and the last iterate
        51
    """

    @property
    def networks(self) -> list[nn.Module]:
        """Networks that it holds, which a pipeline moves to its device."""
        return [value for value in vars(self).values() if isinstance(value, nn.Module)]

    @abstractmethod
    def init(self, raw: Variables, seeds: Tensor) -> Any:
        """Return the memory for these rows.

        Args:
            raw: (N, \\*shape) each.
            seeds: (N,) whole numbers that determine each row's random numbers, whatever the other rows are.

        Raises:
            ValueError: if its settings name unknown variables.
        """

    @abstractmethod
    def step(self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any) -> Step:
        """Take one step; return the new raw variables, the evaluation *at the old ones*, and the new memory."""


class Callback(Part):
    """Observes a fit, and may remove or freeze rows.

    Example:
        >>> import kfit
        >>> class Log(kfit.Callback):
        ...     def on_step(self, state: kfit.FitState) -> kfit.FitState:
        ...         print(state.step, float(state.best_energy.min()))
        ...         return state
    """

    def on_start(self, state: FitState) -> None:
        """Called once, before the first step."""

    def on_step(self, state: FitState) -> FitState:
        """Called after each evaluation; the fit continues with the returned state."""
        return state

    def on_end(self, result: FitResult) -> None:
        """Called once, with the result."""


class Selector(Part, ABC):
    """Selects the winner of each problem.

    Example:
        >>> import torch, kfit
        >>> class First(kfit.Selector):
        ...     def __call__(self, energy, values, problem):
        ...         numbers = torch.arange(int(problem.max()) + 1)
        ...         return (problem == numbers[:, None]).int().argmax(1)
        >>> First()(torch.tensor([0.3, 0.1, 0.2]), {}, torch.tensor([0, 0, 1]))
        tensor([0, 2])
    """

    @abstractmethod
    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        """Return the row (B,) that wins each problem, of R rows in any order; each problem 0…B−1 has at least one."""


class Schedule(Part, ABC):
    """A term's weight that changes over the steps.

    Example:
        >>> import kfit
        >>> class Late(kfit.Schedule):
        ...     def __call__(self, step: int, num_steps: int) -> float:
        ...         return float(step > num_steps / 2)
        >>> Late()(10, 50), Late()(40, 50)
        (0.0, 1.0)
    """

    @abstractmethod
    def __call__(self, step: int, num_steps: int) -> float:
        """Return the weight at ``step`` (0 … num_steps)."""
