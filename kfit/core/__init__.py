"""Contracts and plain values; imports torch alone."""

from kfit.core.check import FitError
from kfit.core.contracts import Callback, Initializer, Optimizer, Schedule, Selector
from kfit.core.encoder import Encoder
from kfit.core.energy import Energy, ResidualEnergy
from kfit.core.evaluate import Evaluate, Linearization
from kfit.core.frozen import frozen
from kfit.core.generator import Generator
from kfit.core.manifolds import SO3, Simplex, UnitVector
from kfit.core.observation import Observation, Rendering
from kfit.core.prior import Prior, ResidualPrior
from kfit.core.result import FitResult, History
from kfit.core.state import Evaluation, FitState, GradientEvaluation, PicturesEvaluation, ResidualEvaluation
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
    "GradientEvaluation",
    "History",
    "Initializer",
    "Linearization",
    "Observation",
    "Optimizer",
    "PicturesEvaluation",
    "Positive",
    "Prior",
    "Real",
    "Rendering",
    "ResidualEnergy",
    "ResidualEvaluation",
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
