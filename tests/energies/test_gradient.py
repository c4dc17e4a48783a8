import cv2
import pytest
import torch
from skimage.data import camera

from kfit.energies import Gradient


def photos():
    photo = torch.from_numpy(camera())[100:140, 200:248].double()[None, None] / 255
    return photo, photo.roll(1, 3)


def test_it_is_the_mean_square_of_the_differences_of_opencvs_sobel_slopes():
    x, y = photos()
    expected = 0.0
    for along in ((1, 0), (0, 1)):
        slopes = [
            cv2.Sobel(picture[0, 0].numpy(), cv2.CV_64F, *along, ksize=3, scale=1 / 8, borderType=cv2.BORDER_REPLICATE)
            for picture in (x, y)
        ]
        expected += ((slopes[0] - slopes[1]) ** 2).mean()
    torch.testing.assert_close(Gradient()(x, y).item(), expected, rtol=1e-10, atol=0)


def test_brightness_does_not_count_and_contrast_does():
    x, _ = photos()
    assert Gradient()(x + 0.2, x).item() < 1e-28
    assert Gradient()(0.8 * x, x).item() > 1e-5


def test_the_border_of_what_is_hidden_is_no_edge():
    x, _ = photos()
    weight = torch.ones(1, 1, 40, 48).double()
    weight[..., 20:30, 10:40] = 0
    assert Gradient()(x, torch.where(weight > 0, x, 0.0), weight).item() == 0


def test_pictures_of_different_shapes_are_refused():
    with pytest.raises(ValueError, match="prediction must have shape"):
        Gradient()(torch.rand(1, 1, 8, 8), torch.rand(1, 3, 8, 8))
