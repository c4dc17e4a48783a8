"""Optimizers that move many rows at once."""

from kfit.optimizers.adam import Adam
from kfit.optimizers.auto_adam import AutoAdam
from kfit.optimizers.cma_es import CMAES
from kfit.optimizers.gauss_newton import GaussNewton
from kfit.optimizers.lbfgs import LBFGS
from kfit.optimizers.learned_steps import LearnedSteps
from kfit.optimizers.levenberg_marquardt import LevenbergMarquardt
from kfit.optimizers.stages import Stages
from kfit.optimizers.torch_optimizer import TorchOptimizer

__all__ = [
    "CMAES",
    "LBFGS",
    "Adam",
    "AutoAdam",
    "GaussNewton",
    "LearnedSteps",
    "LevenbergMarquardt",
    "Stages",
    "TorchOptimizer",
]
