"""A picture that was drawn before, as a generator: what tracking an object moves in its plane."""

from __future__ import annotations

from typing import Any

from kfit.core import Generator, Rendering


class FixedRendering(Generator):
    """Draws one picture, without variables.

    Args:
        drawn: the picture.
    """

    def __init__(self, drawn: Rendering) -> None:
        super().__init__()
        self.drawn, self.variables = drawn, {}

    def forward(self, **values: Any) -> Rendering:
        return self.drawn
