"""Fits: pipeline, objective, starts, schedules, recorder, and gradients and covariance of answers."""

from kfit.fitting.covariance import answer_covariance
from kfit.fitting.implicit import differentiable_answer
from kfit.fitting.pipeline import FitPipeline
from kfit.fitting.schedules import Cosine, Linear, Step

__all__ = ["Cosine", "FitPipeline", "Linear", "Step", "answer_covariance", "differentiable_answer"]
