import pytest
import torch

from kfit.core import Observation
from kfit.initializers import FromCamera


def test_the_focal_length_is_in_picture_widths_one_for_all_starts():
    cameras = torch.tensor([[[20.0, 0, 4], [0, 28.0, 4], [0, 0, 1]], [[80.0, 0, 4], [0, 80.0, 4], [0, 0, 1]]])
    found = FromCamera()({}, Observation(torch.ones(2, 3, 8, 8), intrinsics=cameras), 2, [])
    torch.testing.assert_close(found["focal"], torch.tensor([3.0, 3.0, 10.0, 10.0]))


def test_a_picture_of_no_known_camera_is_an_error():
    with pytest.raises(ValueError, match="observation has no 'intrinsics'"):
        FromCamera()({}, Observation(torch.ones(1, 3, 8, 8)), 1, [])
