"""A generator's relative depth put at a distance, in metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from torch import Tensor

from kfit.core import Generator, Observation, Positive, Rendering, Variable

OWN = ("distance", "focal")


class MetricDepth(Generator):
    """Draws depth as a depth camera measures it: tz is added to the generator's depth (Chen et al. 2020,
    section 4.1, "Results: Translation").

    depth = t · (1 + scale · d / φ), with d the depth behind the object's centre in box diagonals that the generator
    draws. A diagonal D at distance t spans f · D / t pixels, and scale · w where w is a unit diagonal's width in the
    same pixels at scale 1; so D = scale · t / φ with φ = f / w, and depth = t + D · d.

    Adds the variables ``distance`` t (metres, above 0) and ``focal`` φ (above 0). With known intrinsics
    `kfit.initializers.FromDepth` sets φ and a rate of 0 holds it.

    Args:
        generator: draws depth, and has a ``scale``, as `kfit.generators.SimilarityWarp`.

    Raises:
        ValueError: if the generator has no ``scale`` or has variables of these names already; when drawing, if it
            draws no depth.
    """

    def __init__(self, generator: Generator) -> None:
        super().__init__()
        if "scale" not in generator.variables:
            raise ValueError(f"MetricDepth: the generator must have a scale, it has {', '.join(generator.variables)}")
        if taken := [name for name in OWN if name in generator.variables]:
            raise ValueError(f"MetricDepth: the generator has {', '.join(taken)} already")
        self.generator = generator
        self.variables = {**generator.variables} | {name: Variable((), Positive()) for name in OWN}

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        return self.generator.prepare(observation)

    def forward(self, **values: Tensor) -> Rendering:
        drawn: Rendering = self.generator(**{name: value for name, value in values.items() if name not in OWN})
        if drawn.depth is None:
            raise ValueError("MetricDepth: the generator draws no depth")
        distance, size = (value.view(-1, 1, 1, 1) for value in (values["distance"], values["scale"] / values["focal"]))
        return replace(drawn, depth=distance * (1 + size * drawn.depth))
