"""The VGG16 baseline: its network, the rotations that it gives, and how far they are from the truth."""

from __future__ import annotations

import pytest
import torch
from torch import nn
from torch.nn import functional as F

from kfit.baselines import OrientationRegressor
from kfit.baselines.orientation_regressor import _convolutions
from kfit.features import VGG16
from kfit.geometry import rotation_error, rotation_from_angles


def some_rotations(count: int, seed: int) -> torch.Tensor:
    angles = torch.rand(3, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * 6
    return rotation_from_angles(*angles)


@pytest.fixture(scope="module")
def regressor() -> OrientationRegressor:
    torch.manual_seed(0)
    return OrientationRegressor(hidden_dim=32, image_size=32).eval()


def test_has_the_thirteen_convolutions_and_five_poolings_of_vgg16(regressor: OrientationRegressor) -> None:
    # Configuration D of Simonyan and Zisserman, table 1.
    widths = [64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
    assert [layer.out_channels for layer in _convolutions(regressor.features)] == widths
    assert sum(isinstance(layer, nn.MaxPool2d) for layer in regressor.features) == 5


def test_gives_rotations_of_any_picture(regressor: OrientationRegressor) -> None:
    with torch.no_grad():
        output = regressor(torch.rand(4, 3, 32, 32))
    torch.testing.assert_close(output @ output.mT, torch.eye(3).expand(4, 3, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.det(output), torch.ones(4))


def test_six_numbers_stand_for_the_rotation_that_gram_and_schmidt_make_of_them(regressor: OrientationRegressor) -> None:
    raw = torch.randn(1, 6)
    regressor = OrientationRegressor(hidden_dim=4, image_size=32).eval()
    nn.init.zeros_(regressor.output[-1].weight)
    regressor.output[-1].bias.data = raw[0]
    with torch.no_grad():
        found = regressor(torch.rand(1, 3, 32, 32))[0]
    # QR is Gram and Schmidt's, up to signs.
    q, r = torch.linalg.qr(raw.view(2, 3).T)
    torch.testing.assert_close(found[:, 1:], q * r.diagonal().sign())


@pytest.mark.parametrize("symmetry", ["none", "y"])
def test_the_distance_is_one_less_the_cosine_of_the_rotation_error(symmetry: str) -> None:
    regressor = OrientationRegressor(symmetry, hidden_dim=4, image_size=32)
    a, b = some_rotations(20, 1), some_rotations(20, 2)
    torch.testing.assert_close(regressor.distance(a, b), 1 - rotation_error(a, b, symmetry).cos())
    rotated = b @ rotation_from_angles(*torch.tensor([[1.0], [0.0], [0.0]], dtype=torch.float64))
    same = torch.allclose(regressor.distance(a, b), regressor.distance(a, rotated))
    assert same == (symmetry == "y")


def test_the_distance_has_a_slope_that_is_finite_at_the_truth() -> None:
    truth = some_rotations(1, 3)
    output = truth.clone().requires_grad_()
    OrientationRegressor(hidden_dim=4, image_size=32).distance(output, truth).sum().backward()
    assert torch.equal(output.grad, torch.zeros_like(truth))


def test_starts_from_published_weights_where_they_are_given(dev_data) -> None:
    path = str(dev_data / "weights" / "vgg16_features.safetensors")
    regressor = OrientationRegressor(hidden_dim=4, image_size=32)
    regressor.fill(path)
    published = VGG16(("relu1_1",), path)
    image = torch.rand(1, 3, 32, 32)
    plain = F.relu(regressor.features[0]((image - regressor.mean) / regressor.std))
    torch.testing.assert_close(plain, published(image)["relu1_1"])
    assert all(p.requires_grad for p in regressor.parameters())


def test_a_missing_file_of_weights_is_reported() -> None:
    with pytest.raises(FileNotFoundError, match="there is no file nowhere"):
        OrientationRegressor(hidden_dim=4, image_size=32).fill("nowhere.pth")


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "z"}, "symmetry must be one of none, y, y2"),
        ({"image_size": 48}, "image_size must be a multiple of 32, got 48"),
    ],
)
def test_refuses_what_it_cannot_be(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        OrientationRegressor(**settings)


def test_refuses_pictures_of_another_size(regressor: OrientationRegressor) -> None:
    with pytest.raises(ValueError, match=r"image must have shape \(N, 3, 32, 32\), got \(1, 3, 64, 64\)"):
        regressor(torch.rand(1, 3, 64, 64))
