"""Fits: the pipeline, what it evaluates, how it starts, weights over its steps, and what it records."""

from kfit.fitting.pipeline import FitPipeline
from kfit.fitting.schedules import Cosine, Linear, Step

__all__ = ["Cosine", "FitPipeline", "Linear", "Step"]
