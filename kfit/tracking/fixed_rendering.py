"""One picture that is moved in its plane, and starts that are told: what following an object needs of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Angle, Generator, Initializer, Observation, Positive, Rendering, Variable, Variables
from kfit.generators.similarity_warp import warp


class FixedStart(Initializer):
    """Starts at what it is told."""

    def __init__(self, on: Sequence[str] = ("azimuth", "elevation", "roll", "shift", "scale")) -> None:
        self.on = tuple(on)
        self.values: Variables = {}

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        return self.values


class FixedRendering(Generator):
    """One picture, turned, shifted and scaled."""

    drawn: Rendering

    def __init__(self) -> None:
        super().__init__()
        self.variables = {
            "roll": Variable((), Angle()),
            "shift": Variable((2,)),
            "scale": Variable((), Positive()),
        }

    def forward(self, **values: Tensor) -> Rendering:
        return warp(self.drawn, values["roll"], values["shift"], values["scale"])
