"""What an optimizer asks of a fit: energies, gradients and residuals of rows."""

from __future__ import annotations

from typing import Literal, Protocol, overload

from torch import Tensor

from kfit.core.state import Evaluation, GradientEvaluation, PicturesEvaluation, ResidualEvaluation
from kfit.core.variables import Variables

Need = Literal["value", "gradient", "residuals", "pictures"]


class Evaluate(Protocol):
    """Draws rows and compares them under the weights of the step: any number of rows, each with its problem.

    Only ``need="gradient"`` builds a graph. Residuals need all minimised terms to be sums of squares.
    """

    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["value"] = "value") -> Evaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["gradient"]) -> GradientEvaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["residuals"]) -> ResidualEvaluation: ...
    @overload
    def __call__(self, raw: Variables, problem: Tensor, need: Literal["pictures"]) -> PicturesEvaluation: ...
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
