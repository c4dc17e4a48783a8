import math

import pytest
import torch

from kfit.core import Generator, Observation, Positive, Rendering, Variable
from kfit.initializers import Constant, FromDepth

NAN = math.nan


class Step(Generator):
    """Draws two columns of four: the left one 1.1, the right one 0.9 times as far as the distance."""

    def __init__(self):
        super().__init__()
        self.variables = {name: Variable((), Positive()) for name in ("scale", "distance")}

    def forward(self, scale, distance):
        rows = len(distance)
        ratio, mask = torch.tensor([9.0, 1.1, 0.9, 9.0]), torch.tensor([0.0, 1.0, 1.0, 0.0])
        depth = distance[:, None, None, None] * ratio.expand(rows, 1, 4, 4)
        return Rendering(torch.ones(rows, 3, 4, 4), mask.expand(rows, 1, 4, 4), depth)


def distances(depth):
    depth = torch.tensor(depth)
    observed = Observation(torch.ones(len(depth), 3, 4, 4), depth=depth[:, None])
    return FromDepth(Step(), [Constant({"scale": 2.0})])(Step().variables, observed, 2, [])


def test_the_drawn_surface_is_put_on_the_observed_one():
    surface = [[7.0, 1.1 * 0.8, 0.9 * 0.8, 7.0]] * 4
    found = distances([surface, [[NAN, NAN, 0.9 * 0.5, NAN]] * 4])
    assert set(found) == {"scale", "distance"}
    torch.testing.assert_close(found["distance"], torch.tensor([0.8, 0.8, 0.5, 0.5]))


def test_half_of_the_pixels_may_lie_on_the_ground_behind():
    observed, ground = [NAN, 1.1 * 0.8, 0.9 * 0.8, NAN], [NAN, 1.5, 1.6, NAN]
    torch.testing.assert_close(distances([[observed, ground, observed, ground]])["distance"], torch.full((2,), 0.8))


def test_what_nothing_is_drawn_at_counts_where_nothing_else_is_known():
    torch.testing.assert_close(distances([[[9 * 0.7, NAN, NAN, NAN]] * 4])["distance"], torch.full((2,), 0.7))


def test_depth_that_is_known_nowhere_or_missing_is_an_error():
    with pytest.raises(ValueError, match="FromDepth: depth must be known somewhere"):
        distances([[[NAN] * 4] * 4])
    with pytest.raises(ValueError, match="observation has no 'depth'"):
        FromDepth(Step(), [])({}, Observation(torch.ones(1, 3, 4, 4)), 1, [])
