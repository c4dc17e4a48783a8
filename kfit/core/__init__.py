"""Contracts and plain values; imports torch alone."""

from kfit.core.check import FitError
from kfit.core.contracts import (
    Callback,
    Encoder,
    Energy,
    Evaluate,
    Generator,
    Initializer,
    Linearization,
    Optimizer,
    Prior,
    ResidualEnergy,
    ResidualPrior,
    Schedule,
    Selector,
)
from kfit.core.frozen import frozen
from kfit.core.manifolds import SO3, Simplex, UnitVector
from kfit.core.result import FitResult, History
from kfit.core.state import Evaluation, FitState, Observation, Rendering
from kfit.core.variables import Angle, Bounded, Positive, Real, Space, Variable, Variables

__all__ = [
    "SO3",
    "Angle",
    "Bounded",
    "Callback",
    "Encoder",
    "Energy",
    "Evaluate",
    "Evaluation",
    "FitError",
    "FitResult",
    "FitState",
    "Generator",
    "History",
    "Initializer",
    "Linearization",
    "Observation",
    "Optimizer",
    "Positive",
    "Prior",
    "Real",
    "Rendering",
    "ResidualEnergy",
    "ResidualPrior",
    "Schedule",
    "Selector",
    "Simplex",
    "Space",
    "UnitVector",
    "Variable",
    "Variables",
    "frozen",
]
