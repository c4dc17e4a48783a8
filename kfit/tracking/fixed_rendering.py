"""A fixed picture that is moved in its plane, and fixed starts, for tracking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Angle, Generator, Initializer, Observation, Positive, Rendering, Variable, Variables
from kfit.generators.similarity_warp import warp


class FixedStart(Initializer):
    """Start at fixed values."""

    def __init__(self, on: Sequence[str]) -> None:
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
    """One picture, rotated, shifted and scaled."""

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
