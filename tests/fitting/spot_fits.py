"""Fits of a generator that is a formula: a Gaussian spot whose truth is known."""

import torch
from torch import nn

from kfit import FitPipeline
from kfit.core import Angle, Bounded, Generator, Initializer, Observation, Positive, Prior, Rendering, Variable
from kfit.energies import L2
from kfit.initializers import Constant, Uniform
from kfit.optimizers import Adam

SIDE = 16
TRUTH = {
    "x": [0.3, -0.4, 0.1],
    "y": [-0.2, 0.35, 0.1],
    "radius": [0.3, 0.22, 0.4],
    "angle": [0.5, -0.9, 1.2],
}


class Spot(Generator):
    """A dark spot at (x, y), twice as long as wide, its long side turned by an angle."""

    def __init__(self):
        super().__init__()
        self.variables = {
            "x": Variable((), Bounded(-1.0, 1.0)),
            "y": Variable(),
            "radius": Variable((), Positive()),
            "angle": Variable((), Angle()),
        }
        self.ink = nn.Parameter(torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64))
        self.blur = nn.Dropout(0.5)  # draws otherwise unless in evaluation mode

    def forward(self, **values):
        at = {name: value[:, None, None] for name, value in values.items()}
        v, u = torch.meshgrid(*[torch.linspace(-1, 1, SIDE, dtype=torch.float64)] * 2, indexing="ij")
        u, v = u - at["x"], v - at["y"]
        along = at["angle"].cos() * u + at["angle"].sin() * v
        across = at["angle"].cos() * v - at["angle"].sin() * u
        mask = torch.exp(-((along / (2 * at["radius"])).square() + (across / at["radius"]).square()))[:, None]
        return Rendering(1 - self.blur(mask * self.ink[:, None, None]), mask)


def spots(rows=(0, 1, 2), **changes):
    values = {name: torch.tensor(truth, dtype=torch.float64)[list(rows)] for name, truth in (TRUTH | changes).items()}
    with torch.no_grad():
        drawn = Spot().eval()(**values)
    return Observation(drawn.image, drawn.mask, keys=tuple(100 + row for row in rows))


def starts_anywhere():
    return [Uniform("x", -0.6, 0.6), Uniform("y", -0.6, 0.6), Constant({"radius": 0.5}), Uniform("angle", -1.5, 1.5)]


class FixedStart(Initializer):
    """Starts that the test writes down; variables not named start at 0.3."""

    on = ("x", "y", "radius", "angle")

    def __init__(self, **values):
        self.values = values

    def __call__(self, variables, observation, num_starts, rngs):
        rows = observation.num_problems * num_starts
        filled = {name: torch.full((rows,), 0.3, dtype=torch.float64) for name in self.on}
        return filled | {name: torch.tensor(value, dtype=torch.float64) for name, value in self.values.items()}


def pipeline(**changes):
    settings = {
        "generator": Spot(),
        "energies": {"image": L2()},
        "initializers": starts_anywhere(),
        "optimizer": Adam({"x": 0.1, "y": 0.03, "radius": 0.05, "angle": 0.03}),
        "num_starts": 4,
        "num_steps": 12,
    }
    return FitPipeline(**settings | changes)


def counting(fit):
    """Number of rows of each drawing."""
    drawn = []
    fit.generator.register_forward_hook(lambda module, args, rendering: drawn.append(len(rendering.image)))
    return drawn


def path(result, row, start):
    """What one start did: energies, and values by name."""
    history = result.history
    return history.energy[:, row, start], {name: value[:, row, start] for name, value in history.values.items()}


def assert_same_path(found, expected, tolerance=1e-9):
    torch.testing.assert_close(found[0], expected[0], rtol=tolerance, atol=tolerance)
    for name, value in expected[1].items():
        torch.testing.assert_close(found[1][name], value, rtol=tolerance, atol=tolerance)


class Cliff(Prior):
    """Nothing below a height, no number above it."""

    def __init__(self, height, on="y"):
        super().__init__()
        self.height, self.on = height, on

    def forward(self, value):
        return torch.where(value > self.height, torch.nan, 0 * value)
