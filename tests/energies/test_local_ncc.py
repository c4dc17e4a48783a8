import cv2
import pytest
import torch
from skimage.data import astronaut

from kfit.energies import NCC, LocalNCC


def photos():
    photo = (torch.from_numpy(astronaut())[40:80, 180:228].permute(2, 0, 1)[None] / 255).double()
    return photo, photo.roll(2, 3)


def test_at_each_pixel_it_is_opencvs_correlation_of_the_windows():
    x, y = photos()
    for row, column in ((20, 24), (4, 10), (0, 0), (39, 30)):
        window = slice(max(row - 4, 0), row + 5), slice(max(column - 4, 0), column + 5)
        expected = 0
        for channel in range(3):
            patches = [picture[0, channel][window].float().numpy() for picture in (x, y)]
            expected += (1 - cv2.matchTemplate(*patches, cv2.TM_CCOEFF_NORMED)[0, 0]) / 2 / 3
        # the energy's mean over pixels, of this pixel alone
        share = torch.zeros(1, 1, 40, 48, dtype=torch.float64)
        share[..., row, column] = 1 / 3
        found = LocalNCC().compare(x, LocalNCC().prepare(y) | {"share": share})
        torch.testing.assert_close(found.item(), float(expected), rtol=0, atol=5e-3)


def test_light_that_changes_from_place_to_place_counts_less_than_in_the_whole():
    x, _ = photos()
    shade = torch.linspace(0.3, 1, 48, dtype=torch.float64)
    assert LocalNCC()(x * shade, x).item() < 0.25 * NCC()(x * shade, x).item()
    assert LocalNCC()(1 - x, x).item() > 0.95


def test_flat_pictures_agree_also_in_single_precision():
    flat = torch.full((1, 3, 16, 16), 0.7, requires_grad=True)
    found = LocalNCC()(flat, torch.full((1, 3, 16, 16), 0.3))
    assert found.item() < 0.02
    assert torch.autograd.grad(found.sum(), flat)[0].isfinite().all()


@pytest.mark.parametrize("window_size", [1, 4, -3])
def test_a_window_that_has_no_middle_or_no_neighbours_is_refused(window_size):
    with pytest.raises(ValueError, match=r"window_size must be (odd and )?at least 3"):
        LocalNCC(window_size)
