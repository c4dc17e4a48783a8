import pytest
import torch

from kfit.core import Generator, Rendering, Variable
from kfit.generators import MetricDepth


class Slope(Generator):
    """Draws a depth that rises from left to right by a diagonal, from -1/2 on."""

    def __init__(self, depth=True):
        super().__init__()
        self.variables = {"scale": Variable(())}
        self.draws = depth

    def forward(self, **values):
        rows = len(values["scale"])
        depth = (torch.arange(5.0) / 4 - 0.5).expand(rows, 1, 5, 5)
        return Rendering(torch.ones(rows, 3, 5, 5), torch.ones(rows, 1, 5, 5), depth if self.draws else None)


def test_depth_is_the_distance_and_the_diagonal_times_the_relative_depth():
    # A sphere of diameter 1, seen from 1.3, has a silhouette f / √(1.3² − 1/4) = f / 1.2 wide: with f = 3.6 pictures
    # that is 3, the 1.5 · 2 of scale and fraction. So it is from 1.3 diagonals, with twice of both too.
    values = {
        "scale": torch.tensor([1.5, 3.0]),
        "distance": torch.tensor([2.6, 1.3]),
        "focal": torch.tensor([3.6, 7.2]),
    }
    found = MetricDepth(Slope(), 2.0)(**values)
    torch.testing.assert_close(found.depth[0, 0, 0], 2.6 + 2 * (torch.arange(5.0) / 4 - 0.5))
    torch.testing.assert_close(found.depth[1, 0, 0], 1.3 + torch.arange(5.0) / 4 - 0.5)


def test_what_has_no_scale_or_draws_no_depth_or_has_a_distance_is_an_error():
    with pytest.raises(ValueError, match="must have a scale"):
        MetricDepth(Slope().bind(scale=torch.tensor(1.0)), 1.0)
    with pytest.raises(ValueError, match="distance already"):
        MetricDepth(MetricDepth(Slope(), 1.0), 1.0)
    one = torch.ones(1)
    with pytest.raises(ValueError, match="draws no depth"):
        MetricDepth(Slope(depth=False), 1.0)(scale=one, distance=one, focal=one)
