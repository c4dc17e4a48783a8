import jsonargparse
import pytest
import torch
import torch.nn.functional as F
from torch import nn

from kfit.core import Energy, Prior
from kfit.energies import Perceptual
from kfit.features import FeatureNetwork


class Two(FeatureNetwork):
    """Two layers of random features: the second is large and at half the size."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.first, self.second = nn.Conv2d(3, 4, 3, padding=1), nn.Conv2d(4, 6, 3, stride=2, padding=1)
        self.calls = 0
        self.freeze()

    def forward(self, image):
        self.calls += 1
        first = self.first(self.normalized(image))
        return {"first": first, "second": 50 * self.second(first)}


def pictures():
    rng = torch.Generator().manual_seed(3)
    return [torch.rand(2, 3, 8, 8, generator=rng) for _ in range(2)]


def test_one_layer_is_the_plain_mean_squared_difference_of_the_released_code():
    network, (x, y) = nn.Conv2d(3, 5, 3), pictures()
    expected = F.mse_loss(network(x), network(y), reduction="none").mean((1, 2, 3))
    torch.testing.assert_close(Perceptual(network)(x, y), expected.detach())


def test_several_layers_count_alike_each_over_the_mean_square_of_its_target():
    network, (x, y) = Two(), pictures()
    shown, observed = network(x), network(y)
    ratios = [
        (shown[k] - observed[k]).square().mean((1, 2, 3)) / observed[k].square().mean((1, 2, 3)) for k in observed
    ]
    torch.testing.assert_close(Perceptual(network)(x, y), sum(ratios) / 2)
    plain = [(shown[k] - observed[k]).square().mean((1, 2, 3)) for k in observed]
    torch.testing.assert_close(Perceptual(network, normalize=False)(x, y), sum(plain) / 2)


def test_not_squared_it_is_the_papers_norm():
    network, (x, y) = nn.Conv2d(3, 5, 3), pictures()
    expected = F.mse_loss(network(x), network(y), reduction="none").mean((1, 2, 3)).sqrt()
    torch.testing.assert_close(Perceptual(network, squared=False)(x, y), expected.detach())


def test_a_half_hidden_object_has_its_least_energy_at_the_truth():
    _, truth = pictures()
    weight = torch.ones(2, 1, 8, 8)
    weight[:, :, :, 4:] = 0
    observed = torch.where(weight > 0, truth, torch.tensor(0.2))
    energy = Perceptual(Two())
    assert energy(truth, observed, weight).abs().max() < 1e-10
    assert energy(truth, observed).min() > 1e-3


def test_the_target_goes_through_the_network_once():
    energy, (x, y) = Perceptual(Two()), pictures()
    prepared = energy.prepare(y)
    for _ in range(3):
        energy.compare(x, prepared)
    assert energy.network.calls == 4


def test_its_network_is_a_frozen_copy_and_the_given_one_stays_as_it_was():
    inputs = nn.Sequential(nn.Conv2d(3, 4, 3), nn.BatchNorm2d(4))
    energy, (x, y) = Perceptual(inputs).train(), pictures()
    assert energy.training
    assert not any(module.training for module in energy.network.modules())
    x.requires_grad_()
    energy(x, y).sum().backward()
    assert x.grad is not None
    assert not any(p.requires_grad for p in energy.parameters())
    assert inputs.training
    assert all(p.requires_grad for p in inputs.parameters())


def test_under_bfloat16_the_energy_is_still_summed_in_float32():
    energy, (x, y) = Perceptual(Two()), pictures()
    with torch.autocast("cpu", torch.bfloat16):
        found = energy(x, y)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, energy(x, y), rtol=0.05, atol=0)


def test_a_recipe_builds_energies_with_their_networks():
    parser = jsonargparse.ArgumentParser()
    parser.add_argument("--energies", type=dict[str, Energy | Prior])
    recipe = """
    energies:
      features:
        class_path: kfit.energies.Perceptual
        init_args:
          network:
            class_path: kfit.features.EfficientNetLite0
            init_args: {layers: [3, 5]}
      prior: kfit.energies.CodePrior
    """
    energies = parser.instantiate(parser.parse_string(recipe)).energies
    assert set(energies["features"].prepare(torch.rand(1, 3, 32, 32))["target"]) == {"block3", "block5"}
    assert energies["prior"].on == "code"


def test_a_picture_that_is_not_rgb_is_refused():
    with pytest.raises(ValueError, match=r"image must have shape \(N, 3, H, W\)"):
        Perceptual(Two()).prepare(torch.rand(1, 4, 8, 8))


def test_a_network_in_single_precision_compares_pictures_in_double():
    torch.manual_seed(0)
    energy = Perceptual(nn.Conv2d(3, 4, 3))
    x, y = torch.rand(2, 2, 3, 8, 8)
    torch.testing.assert_close(energy(x.double(), y.double()), energy(x, y))
