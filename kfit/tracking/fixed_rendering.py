"""A drawn picture that is moved in its plane, for tracking."""

from __future__ import annotations

from typing import Any

from kfit.core import Generator, Observation, Rendering, Variables
from kfit.energies import L2, Silhouette
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import SimilarityWarp
from kfit.initializers import Constant
from kfit.optimizers import GaussNewton

# Finite differences of roll, shift and scale in raw units: about 2° and 0.7 pixel.
LENGTHS = {"roll": 0.012, "shift": 0.02, "scale": 0.02}
STEPS = 3


class FixedRendering(Generator):
    """A generator of one drawn picture, without variables.

    Args:
        drawn: the picture.
    """

    def __init__(self, drawn: Rendering) -> None:
        super().__init__()
        self.drawn, self.variables = drawn, {}

    def forward(self, **values: Any) -> Rendering:
        return self.drawn


def moved_in_plane(drawn: Rendering, values: Variables, observation: Observation) -> Variables:
    """Fit roll, shift and scale of one drawn picture by three steps of Gauss-Newton.

    Args:
        drawn: the picture before the warp.
        values: where they start, (1, \\*shape) each.
        observation: with a mask.

    Returns:
        Their fitted values.
    """
    # Features are too rough for such long differences: with EfficientNet's, Gauss-Newton hardly moves.
    place = FitPipeline(
        SimilarityWarp(FixedRendering(drawn)),
        {"image": L2(), "silhouette": Silhouette()},
        [Constant({name: values[name][0].tolist() for name in LENGTHS})],
        GaussNewton(LENGTHS),
        num_starts=1,
        num_steps=STEPS,
    )
    return place(observation, seed=0).values
