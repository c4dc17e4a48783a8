import pytest
import torch
from skimage.data import astronaut
from skimage.metrics import structural_similarity
from skimage.transform import downscale_local_mean
from torchmetrics.functional.image import multiscale_structural_similarity_index_measure

from kfit.energies import MSSSIM

# Wang et al. 2003, section 3.2
EXPONENTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


def photos(size):
    """Part of a photo, and others beside it: dimmed, noisy, moved."""
    photo = (torch.from_numpy(astronaut())[:size, 100 : 100 + size].permute(2, 0, 1)[None] / 255).double()
    noisy = (photo + 0.1 * torch.randn(photo.shape, dtype=torch.float64)).clamp(0, 1)
    return photo, torch.cat([0.6 * photo + 0.2, noisy, photo.roll(2, 3)])


def scikit_images_ssim(x, y):
    """Mean over windows that stay inside the picture, as the paper has it."""
    return structural_similarity(
        x, y, channel_axis=0, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )


@pytest.mark.parametrize(
    ("size", "num_scales", "changes"), [(64, 3, (0, 1, 2)), pytest.param(176, 5, (1,), marks=pytest.mark.slow)]
)
def test_fine_scales_are_torchmetrics_s_and_the_coarsest_scikit_image_s_ssim(size, num_scales, changes):
    x, changed = photos(size)
    total = sum(EXPONENTS[:num_scales])
    for y in changed[list(changes)].unsqueeze(1):
        expected = 1.0
        for scale in range(num_scales - 1):
            # an exponent of 1 at one scale and 0 elsewhere gives its factor alone
            alone = tuple(float(other == scale) for other in range(num_scales))
            factor = multiscale_structural_similarity_index_measure(
                y, x, data_range=1.0, betas=alone, normalize="relu"
            ).item()
            expected *= factor ** (EXPONENTS[scale] / total)
        by = 2 ** (num_scales - 1)
        coarse = [downscale_local_mean(picture[0].numpy(), (1, by, by)) for picture in (x, y)]
        # torchmetrics mirrors the picture at its border at this scale, which the paper does not
        expected *= scikit_images_ssim(*coarse) ** (EXPONENTS[num_scales - 1] / total)
        torch.testing.assert_close(MSSSIM()(y, x).item(), 1 - expected, rtol=1e-6, atol=1e-9)


def test_one_scale_is_scikit_images_ssim():
    x, changed = photos(64)
    for y in changed.unsqueeze(1):
        expected = 1 - scikit_images_ssim(x[0].numpy(), y[0].numpy())
        torch.testing.assert_close(MSSSIM(num_scales=1)(y, x).item(), expected, rtol=1e-6, atol=1e-9)


def test_a_negative_keeps_a_slope_where_its_fine_scales_have_none():
    x = photos(64)[0]
    y = (1 - x).requires_grad_()
    found = MSSSIM()(y, x)
    assert 0.5 < found.item() < 1
    assert torch.autograd.grad(found.sum(), y)[0].abs().sum() > 0


def test_a_hidden_half_leaves_the_least_energy_at_the_truth():
    x = photos(64)[0]
    weight = torch.ones(1, 1, 64, 64).double()
    weight[..., 40:] = 0
    observed = torch.where(weight > 0, x, 0.3)
    assert MSSSIM()(x, observed, weight).abs().item() < 1e-12
    assert MSSSIM()(x, observed).item() > 0.1


def test_as_many_scales_as_fit_are_taken_and_more_are_refused():
    picture = torch.rand(1, 1, 64, 64)
    assert len(MSSSIM().prepare(picture)["scales"]) == 3
    assert len(MSSSIM().prepare(torch.rand(1, 1, 64, 43))["scales"]) == 2
    assert len(MSSSIM(window_size=3).prepare(picture)["scales"]) == 5
    with pytest.raises(ValueError, match="at least 88 pixels high and wide for 4 scales of a window of 11"):
        MSSSIM(num_scales=4).prepare(picture)
    with pytest.raises(ValueError, match="at least 11 pixels high and wide for 1 scales"):
        MSSSIM().prepare(torch.rand(1, 1, 8, 64))


@pytest.mark.parametrize("num_scales", [0, 6])
def test_a_number_of_scales_without_exponents_is_refused(num_scales):
    with pytest.raises(ValueError, match="num_scales must lie between 1 and 5"):
        MSSSIM(num_scales)


def test_a_window_that_has_no_middle_is_refused():
    with pytest.raises(ValueError, match="window_size must be odd and positive"):
        MSSSIM(window_size=4)


def test_a_move_by_two_pixels_costs_less_than_at_the_finest_scale_alone():
    x, changed = photos(64)
    assert MSSSIM()(changed[2:], x) < MSSSIM(num_scales=1)(changed[2:], x)


def test_a_training_under_autocast_gets_the_numbers_of_single_precision():
    x = torch.from_numpy(astronaut()[:64, :64]).permute(2, 0, 1)[None].float() / 255
    y = (x + 0.01 * torch.rand(x.shape, generator=torch.Generator().manual_seed(0))).clamp(0, 1)
    expected = MSSSIM()(x, y)
    with torch.autocast("cpu", torch.bfloat16):
        found = MSSSIM()(x, y)
    assert found > 0
    torch.testing.assert_close(found, expected, rtol=0, atol=0)
