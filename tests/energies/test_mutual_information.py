import kornia
import pytest
import torch
from skimage.data import camera
from skimage.metrics import normalized_mutual_information

from kfit.energies import L1, MutualInformation


def photos(num_bins=None):
    """Part of a photo and the same moved; with colours at the centres of so many bins, where soft bins are hard."""
    photo = torch.from_numpy(camera())[100:164, 200:264].double()[None, None] / 255
    if num_bins is not None:
        photo = (photo * (num_bins - 1)).round() / (num_bins - 1)
    return photo, photo.roll((2, 5), (2, 3))


@pytest.mark.parametrize("num_bins", [8, 32])
def test_with_colours_at_the_centres_of_bins_it_is_two_minus_scikit_images(num_bins):
    x, y = photos(num_bins)
    for moved in (y, x, 1 - x, x.square().mul(num_bins - 1).round() / (num_bins - 1)):
        # scikit-image spans each picture's own range: a pixel of each end gives both the whole of it
        pictures = [picture.clone() for picture in (moved, x)]
        for picture in pictures:
            picture[..., 0, 0], picture[..., 0, 1] = 0, 1
        expected = 2 - normalized_mutual_information(*(picture.numpy() for picture in pictures), bins=num_bins)
        torch.testing.assert_close(MutualInformation(num_bins)(*pictures).item(), expected, rtol=1e-9, atol=1e-9)


def test_channels_have_histograms_of_their_own():
    x, y = photos()
    apart = [MutualInformation()(*pair) for pair in ((y, x), (x, y.flip(2)))]
    together = MutualInformation()(torch.cat([y, x], 1), torch.cat([x, y.flip(2)], 1))
    torch.testing.assert_close(together, sum(apart) / 2)


def test_a_negative_is_as_near_as_the_picture_itself_where_pixels_disagree():
    x, y = photos()
    energy = MutualInformation()
    torch.testing.assert_close(energy(1 - x, x), energy(x, x))
    assert energy(1 - x, x) < energy(y, x)
    assert L1()(1 - x, x) > L1()(y, x)


def test_a_weight_counts_a_pixel_as_often():
    rng = torch.Generator().manual_seed(0)
    x, y = torch.rand(2, 1, 1, 1, 12, generator=rng, dtype=torch.float64)
    counts = torch.randint(0, 4, (1, 1, 1, 12), generator=rng)
    repeated = [picture.flatten().repeat_interleave(counts.flatten()).view(1, 1, 1, -1) for picture in (x, y)]
    torch.testing.assert_close(MutualInformation(8)(x, y, counts), MutualInformation(8)(*repeated))


def test_pictures_of_one_colour_agree_and_tell_nothing_of_others():
    x, _ = photos()
    flat = torch.full_like(x, 0.4).requires_grad_()
    assert MutualInformation(11)(flat, torch.full_like(x, 0.6)).item() == pytest.approx(0, abs=1e-9)
    found = MutualInformation(11)(flat, x)
    assert found.item() == pytest.approx(1, abs=1e-9)
    assert torch.autograd.grad(found.sum(), flat)[0].isfinite().all()


def test_fewer_than_two_bins_are_refused():
    with pytest.raises(ValueError, match="num_bins must be at least 2"):
        MutualInformation(1)


def test_it_is_kornias_normalized_loss_for_pictures_that_fill_the_range():
    rng = torch.Generator().manual_seed(0)
    x, y = torch.rand(2, 2, 1, 20, 20, generator=rng, dtype=torch.float64)
    y = 0.5 * x + 0.5 * y
    for picture in (x, y):  # Kornia stretches each to its own range
        picture[..., 0, 0], picture[..., 0, 1] = 0, 1
    expected = 2 + kornia.losses.normalized_mutual_information_loss_2d(x, y, num_bins=16).mean(1)
    torch.testing.assert_close(MutualInformation(16)(x, y), expected, rtol=1e-6, atol=1e-6)
