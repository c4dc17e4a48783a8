import torch

from kfit.energies import Silhouette, SoftIoU

A = torch.tensor([[[[1.0, 0.5, 0.0, 0.0]]]])
B = torch.tensor([[[[1.0, 1.0, 0.5, 0.0]]]])


def test_both_compare_masks():
    assert Silhouette().on == SoftIoU().on == "mask"


def test_silhouette_is_the_mean_squared_difference():
    torch.testing.assert_close(Silhouette()(A, B), torch.tensor([0.5 / 4]))


def test_soft_iou_is_one_minus_intersection_over_union():
    torch.testing.assert_close(SoftIoU()(A, B), torch.tensor([1 - 1.5 / 2.5]))
    torch.testing.assert_close(SoftIoU()(A, B, torch.tensor([[[[1.0, 0.0, 1.0, 1.0]]]])), torch.tensor([1 - 1 / 1.5]))


def test_two_empty_masks_agree_and_an_empty_one_misses_a_full_one():
    empty = torch.zeros(1, 1, 2, 2, requires_grad=True)
    found = SoftIoU()(empty, torch.zeros(1, 1, 2, 2))
    assert found.item() == 0
    assert torch.autograd.grad(found.sum(), empty)[0].isfinite().all()
    assert SoftIoU()(empty, torch.ones(1, 1, 2, 2)).item() == 1
