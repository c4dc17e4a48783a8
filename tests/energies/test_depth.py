import pytest
import torch

from kfit.energies import L1, Depth, GemanMcClure

NAN, INF = float("nan"), float("inf")


def test_it_is_l1_over_the_pixels_whose_target_is_known():
    x = torch.tensor([[[[1.0, 2.0, 3.0, 4.0]]]])
    y = torch.tensor([[[[1.5, NAN, INF, 3.0]]]])
    assert Depth().on == "depth"
    torch.testing.assert_close(Depth()(x, y), torch.tensor([(0.5 + 1) / 2]))
    torch.testing.assert_close(Depth()(x, y, torch.tensor([[[[3.0, 5.0, 0.0, 1.0]]]])), torch.tensor([(1.5 + 1) / 4]))
    torch.testing.assert_close(Depth()(x, x - 1), L1()(x, x - 1))


def test_unknown_pixels_pass_no_gradient_and_rows_without_any_known_are_zero():
    x = torch.ones(2, 1, 1, 2, requires_grad=True)
    found = Depth()(x, torch.tensor([[[[NAN, 2.0]]], [[[NAN, NAN]]]]))
    assert found.tolist() == [1, 0]
    assert torch.autograd.grad(found.sum(), x)[0].tolist() == [[[[0, -1]]], [[[0, 0]]]]


def test_a_boolean_weight_marks_what_is_known():
    x, y = torch.tensor([[[[1.0, 2.0]]]]), torch.tensor([[[[0.0, 2.5]]]])
    torch.testing.assert_close(Depth()(x, y, y > 0), torch.tensor([0.5]))


def test_with_a_robust_energy_what_is_far_behind_costs_no_more_the_farther():
    x, y = torch.zeros(1, 1, 1, 4), torch.tensor([[[[0.0, 0.0, NAN, 0.5]]], [[[0.0, 0.0, NAN, 5.0]]]])
    near, far = Depth(GemanMcClure(0.01))(x.expand(2, 1, 1, 4), y).tolist()
    assert near == pytest.approx(far, rel=0.01)
    assert far == pytest.approx(2 / 3, rel=0.01)


def test_a_picture_is_refused():
    with pytest.raises(ValueError, match=r"target must have shape \(N, 1, H, W\)"):
        Depth()(torch.rand(1, 3, 4, 4), torch.rand(1, 3, 4, 4))
