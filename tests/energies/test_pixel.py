import pytest
import torch

from kfit.energies import L1, L2

# two channels, two pixels: differences (0.5, 0.25) in the left pixel, (0, 1) in the right one
X = torch.tensor([[[[0.5, 0.2]], [[0.25, 1.0]]]])
Y = torch.tensor([[[[1.0, 0.2]], [[0.0, 0.0]]]])


def test_l1_is_the_mean_absolute_difference():
    torch.testing.assert_close(L1()(X, Y), torch.tensor([1.75 / 4]))


def test_l2_is_the_mean_squared_difference():
    torch.testing.assert_close(L2()(X, Y), torch.tensor([(0.25 + 0.0625 + 1) / 4]))


def test_a_weight_makes_it_a_weighted_mean_over_pixels():
    weight = torch.tensor([[[[3.0, 1.0]]]])
    torch.testing.assert_close(L1()(X, Y, weight), torch.tensor([(3 * 0.375 + 0.5) / 4]))
    torch.testing.assert_close(L2()(X, Y, weight), torch.tensor([(3 * 0.3125 / 2 + 0.5) / 4]))


def test_a_boolean_weight_serves_as_well():
    torch.testing.assert_close(L1()(X, Y, torch.tensor([[[[True, False]]]])), torch.tensor([0.375]))


@pytest.mark.parametrize("energy", [L1(), L2()])
def test_pictures_of_different_shapes_are_refused_instead_of_broadcast(energy):
    with pytest.raises(ValueError, match="prediction must have shape"):
        energy(X[:, :1], Y)
