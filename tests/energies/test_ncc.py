import cv2
import pytest
import torch
from skimage.data import astronaut

from kfit.energies import NCC


def photos():
    photo = (torch.from_numpy(astronaut())[40:104, 160:224].permute(2, 0, 1)[None] / 255).double()
    return photo, torch.cat([photo.roll(3, 3), photo.flip(2), 1 - photo, torch.rand(photo.shape, dtype=torch.float64)])


def opencvs(x, y):
    images = [picture[0].permute(1, 2, 0).float().numpy() for picture in (x, y)]
    return float(cv2.matchTemplate(*images, cv2.TM_CCOEFF_NORMED)[0, 0])


def test_it_is_half_of_one_minus_opencvs_correlation_coefficient():
    x, others = photos()
    for y in others.unsqueeze(1):
        torch.testing.assert_close(NCC()(y, x).item(), (1 - opencvs(y, x)) / 2, rtol=0, atol=2e-6)


def test_of_one_channel_it_is_pearsons_correlation_with_weights_as_counts():
    torch.manual_seed(2)
    x, y = torch.rand(2, 1, 1, 3, 4, dtype=torch.float64)
    counts = torch.randint(0, 4, (1, 1, 3, 4))
    repeated = [picture.flatten().repeat_interleave(counts.flatten()) for picture in (x, y)]
    expected = (1 - torch.corrcoef(torch.stack(repeated))[0, 1]) / 2
    torch.testing.assert_close(NCC()(x, y, counts)[0], expected, rtol=0, atol=1e-6)


def test_gain_and_offset_do_not_count_and_a_negative_is_at_the_far_end():
    x, _ = photos()
    offsets = torch.tensor([0.1, 0.2, 0.0]).view(1, 3, 1, 1)
    assert NCC()(0.4 * x + offsets, x).item() < 1e-6
    assert NCC()(1 - x, x).item() > 1 - 1e-6


def test_a_flat_picture_is_half_way_from_any_other_and_agrees_with_a_flat_one():
    x, _ = photos()
    for dtype in (torch.float32, torch.float64):
        flat = torch.full_like(x, 0.7, dtype=dtype).requires_grad_()
        found = NCC()(flat, x.to(dtype))
        assert found.item() == pytest.approx(0.5, abs=1e-3)
        assert torch.autograd.grad(found.sum(), flat)[0].isfinite().all()
        assert NCC()(flat, torch.full_like(flat, 0.2)).item() < 1e-3
