"""A generator's relative depth, converted to metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from torch import Tensor

from kfit.core import Generator, Observation, Positive, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.geometry.camera import distance_by_focal


class MetricDepth(Generator):
    """Draw depth in metres, as a depth camera measures it (Chen et al. 2020, section 4.1, "Results: Translation").

    depth = t · (1 + d / d₀), with d the generator's depth behind the object's centre in box diagonals, and d₀ the
    distance of the camera in box diagonals, which `kfit.geometry.distance_by_focal` gives for focal / scale: at t
    metres the diagonal is D = t / d₀ metres, and depth = t + D · d.

    Adds the variable ``distance`` t (metres, above 0) and, to a generator without it, ``focal``, the focal length over
    the picture's width (above 0).

    Args:
        generator: draws depth, and has a ``scale``, as `kfit.generators.SimilarityWarp`.
        unit_fraction: fraction of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Raises:
        ValueError: if the generator has no ``scale`` or has a ``distance`` already, if ``unit_fraction`` is outside
            [0.1, 10] and, when drawing, if the generator draws no depth.

    Example:
        >>> from kfit.generators import VAE2D, MetricDepth, SimilarityWarp
        >>> generator = MetricDepth(SimilarityWarp(VAE2D(depth=True)), unit_fraction=1.0)
        >>> sorted(generator.variables)
        ['azimuth', 'code', 'distance', 'elevation', 'focal', 'roll', 'scale', 'shift']
    """

    def __init__(self, generator: Generator, unit_fraction: float) -> None:
        super().__init__()
        if "scale" not in generator.variables:
            raise ValueError(f"MetricDepth: the generator must have a scale, it has {', '.join(generator.variables)}")
        if "distance" in generator.variables:
            raise ValueError("MetricDepth: the generator has distance already")
        check_arguments(MetricDepth, locals(), unit_fraction=(0.1, 10.0))
        self.generator, self.unit_fraction = generator, unit_fraction
        own = {name: Variable((), Positive()) for name in ("focal", "distance")}
        self.variables = {**own, **generator.variables}

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        return self.generator.prepare(observation)

    def forward(self, **values: Tensor) -> Rendering:
        drawn: Rendering = self.generator(**{name: values[name] for name in self.generator.variables})
        if drawn.depth is None:
            raise ValueError("MetricDepth: the generator draws no depth")
        away = distance_by_focal(values["focal"] / values["scale"], self.unit_fraction)
        distance, diagonal = (value.view(-1, 1, 1, 1) for value in (values["distance"], values["distance"] / away))
        return replace(drawn, depth=distance + diagonal * drawn.depth)
