import math

import pytest
import torch

from kfit.core import Observation
from kfit.initializers import FromDepth

CAMERA = torch.tensor([[[240.0, 0, 4], [0, 240.0, 4], [0, 0, 1]]])


def given(depth, camera=CAMERA):
    return FromDepth(0.75)({}, Observation(torch.ones(1, 3, 8, 8), depth=depth, intrinsics=camera), 2, [])


def test_focal_is_in_unit_diagonals_and_distance_a_little_behind_the_surface():
    depth = torch.full((1, 1, 8, 8), math.nan)
    depth[0, 0, 2, 2:5] = torch.tensor([0.9, 1.0, 5.0])
    found = given(depth)
    torch.testing.assert_close(found["focal"], torch.full((2,), 240 / (0.75 * 8)))
    torch.testing.assert_close(found["distance"], torch.full((2,), 1 + 0.2 / 40))


def test_depth_that_is_known_nowhere_and_what_is_missing_is_an_error():
    with pytest.raises(ValueError, match="FromDepth: depth must be known somewhere"):
        given(torch.full((1, 1, 8, 8), math.nan))
    with pytest.raises(ValueError, match="intrinsics"):
        given(torch.ones(1, 1, 8, 8), None)
    with pytest.raises(ValueError, match="FromDepth: unit_fraction"):
        FromDepth(0.0)
