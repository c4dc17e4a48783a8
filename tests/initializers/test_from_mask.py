import pytest
import torch

from kfit.core import Observation, Rendering
from kfit.generators.similarity_warp import warp
from kfit.initializers import FromMask


def initial(mask, num_starts=1):
    picture = torch.ones(len(mask), 3, *mask.shape[2:])
    return FromMask()({}, Observation(picture, mask), num_starts, [])["shift"]


def test_a_centred_object_shifted_by_what_it_says_lies_on_the_mask():
    mask = torch.zeros(2, 1, 16, 16)
    mask[0, 0, 1:5, 9:15] = 1
    mask[1, 0, 10:16, 2:3] = 1
    shift = initial(mask)
    torch.testing.assert_close(shift, torch.tensor([[0.5, 0.625], [-0.6875, -0.625]]))
    for row, size in ((0, (4, 6)), (1, (6, 2))):  # as large, in the middle
        high, wide = size
        centred = torch.zeros(1, 1, 16, 16)
        centred[0, 0, 8 - high // 2 : 8 + high // 2, 8 - wide // 2 : 8 + wide // 2] = 1
        still, same = torch.zeros(1), torch.ones(1)
        moved = warp(Rendering(centred.expand(1, 3, 16, 16), centred), still, shift[row : row + 1], same).mask
        assert bool((moved[mask[row : row + 1] == 1] >= 0.49).all())


def test_each_problem_has_its_own_and_all_its_starts_the_same():
    mask = torch.zeros(2, 1, 8, 8)
    mask[0, 0, :4, :4] = 1
    mask[1, 0, 4:, 4:] = 1
    torch.testing.assert_close(initial(mask, 2), torch.tensor([[-0.5, 0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, -0.5]]))


def test_an_empty_or_a_full_mask_starts_in_the_middle():
    assert initial(torch.zeros(1, 1, 8, 8)).tolist() == initial(torch.ones(1, 1, 8, 8)).tolist() == [[0.0, 0.0]]


def test_an_observation_without_a_mask_is_an_error():
    with pytest.raises(ValueError, match="mask"):
        FromMask()({}, Observation(torch.ones(1, 3, 8, 8)), 1, [])
