import pytest
import torch
from skimage.metrics import structural_similarity

from kfit.energies import SSIM


def framed(seed):
    """A picture in a white frame wider than the window, where the ways of treating a border agree."""
    picture = torch.ones(1, 3, 46, 50, dtype=torch.float64)
    picture[:, :, 12:34, 12:38] = torch.rand(3, 22, 26, generator=torch.Generator().manual_seed(seed)).double()
    return picture


def test_it_is_half_of_one_minus_scikit_images_structural_similarity():
    x = framed(0)
    for y in (framed(1), 0.7 * x + 0.3 * framed(2)):
        _, reference = structural_similarity(
            *(picture[0].numpy() for picture in (x, y)),
            channel_axis=0, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True,
        )  # fmt: skip
        torch.testing.assert_close(SSIM()(x, y), torch.tensor([(1 - reference.mean()) / 2]), atol=1e-7, rtol=1e-6)


def test_a_weight_averages_the_map_over_the_pixels_that_count():
    x, y = framed(0), framed(1)
    weight = torch.full((1, 1, 46, 50), 1e-9).double()
    weight[:, :, 20, 25] = 1
    _, reference = structural_similarity(
        *(picture[0].numpy() for picture in (x, y)),
        channel_axis=0, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True,
    )  # fmt: skip
    at_pixel = (1 - reference[:, 20, 25].mean()) / 2
    torch.testing.assert_close(SSIM()(x, y, weight), torch.tensor([at_pixel]), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("window_size", [0, 4, -3])
def test_a_window_that_has_no_middle_is_refused(window_size):
    with pytest.raises(ValueError, match=r"window_size must be (odd and positive|at least 1)"):
        SSIM(window_size)


def test_pictures_and_volumes_smaller_than_half_the_window_are_refused():
    x = torch.rand(1, 3, 6, 6)
    assert SSIM()(x, x) == 0
    with pytest.raises(ValueError, match=r"target must be at least 6 pixels along each side, got \(5, 5\)"):
        SSIM()(x[..., :5, :5], x[..., :5, :5])
    with pytest.raises(ValueError, match=r"target must be at least 6 pixels along each side, got \(2, 6, 6\)"):
        SSIM()(x[:, :, None].expand(-1, -1, 2, -1, -1), x[:, :, None].expand(-1, -1, 2, -1, -1))
