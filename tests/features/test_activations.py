import copy
from concurrent.futures import ThreadPoolExecutor

import jsonargparse
import pytest
import torch
from torch import nn

from kfit.core import Energy, frozen
from kfit.energies import Perceptual
from kfit.features import Activations


class Tokens(nn.Module):
    """A small transformer over patches, with tokens in front: the last block gives out a tuple."""

    def __init__(self, num_prefix_tokens=1):
        super().__init__()
        self.patches = nn.Conv2d(3, 8, 4, 4)
        self.prefix = nn.Parameter(torch.zeros(1, num_prefix_tokens, 8))
        self.blocks = nn.ModuleList(nn.Linear(8, 8) for _ in range(2))
        self.unused = nn.Linear(8, 8)

    def forward(self, image):
        x = self.patches(image).flatten(2).transpose(1, 2)
        x = torch.cat([self.prefix.expand(len(x), -1, -1), x], 1)
        for block in self.blocks:
            x = block(x)
        return x, "and more"


def convolutions():
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(3, 4, 3, padding=1), nn.ReLU(inplace=True), nn.Sequential(nn.Conv2d(4, 5, 3)))


def test_it_gives_what_the_named_modules_gave_for_the_normalised_picture():
    network, image = convolutions(), torch.rand(2, 3, 8, 8)
    found = Activations(network, ["0", "2.0"])(image)
    first = network[0](
        (image - torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)) / torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
    )
    # before the rectifier that works in place
    torch.testing.assert_close(found["0"], first.detach())
    torch.testing.assert_close(found["2.0"], network[2](first.relu()).detach())
    plain = Activations(network, ["0"], mean=(0, 0, 0), std=(1, 1, 1))(image)
    torch.testing.assert_close(plain["0"], network[0](image).detach())


def test_the_network_that_was_given_stays_as_it_was():
    network = convolutions()
    Activations(network, ["0"])
    assert network.training
    assert all(p.requires_grad for p in network.parameters())
    assert not any(module._forward_hooks for module in network.modules())


def test_twins_and_copies_have_hooks_of_their_own():
    made, image = Activations(convolutions(), ["2.0"]), torch.rand(1, 3, 8, 8)
    for twin in (frozen(made), copy.deepcopy(made), frozen(frozen(made)), Perceptual(made).network):
        torch.testing.assert_close(twin(image), made(image))
    assert not any(p.requires_grad for p in frozen(made).parameters())
    changed = copy.deepcopy(made)
    nn.init.zeros_(changed.network[2][0].weight)
    assert not torch.equal(changed(image)["2.0"], made(image)["2.0"])


def test_threads_that_share_one_see_their_own_pictures():
    made = Activations(convolutions(), ["0", "2.0"])
    pictures = torch.rand(24, 1, 3, 16, 16)
    alone = [made(picture) for picture in pictures]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(made, pictures))
    torch.testing.assert_close(together, alone, rtol=0, atol=0)


def test_one_inside_another_keeps_apart():
    inner = Activations(convolutions(), ["0"])

    class Outer(nn.Module):
        def __init__(self):
            super().__init__()
            self.inner, self.last = inner, nn.Conv2d(4, 2, 1)

        def forward(self, image):
            return self.last(self.inner(image)["0"])

    assert set(Activations(Outer(), ["last"])(torch.rand(1, 3, 8, 8))) == {"last"}


@pytest.mark.parametrize("num_prefix_tokens", [0, 1, 5])
def test_tokens_become_a_picture_of_the_pictures_aspect(num_prefix_tokens):
    torch.manual_seed(0)
    network, image = Tokens(num_prefix_tokens), torch.rand(2, 3, 12, 20)
    made = Activations(network, ["patches", "blocks.1", ""], num_prefix_tokens)
    found = made(image)
    assert found["patches"].shape == found["blocks.1"].shape == (2, 8, 3, 5)
    tokens = network(made.normalized(image))[0]
    torch.testing.assert_close(found["blocks.1"][:, :, 1, 2], tokens[:, num_prefix_tokens + 7].detach())
    torch.testing.assert_close(found[""], found["blocks.1"])


def test_gradients_reach_the_picture_through_tokens():
    energy = Perceptual(Activations(Tokens(), ["blocks.0", "blocks.1"], 1))
    x, y = torch.rand(2, 2, 3, 8, 8)
    weight = torch.ones(2, 1, 8, 8)
    weight[..., :3] = 0
    gradient = torch.autograd.grad(energy(x.requires_grad_(), y, weight).sum(), x)[0]
    assert gradient[..., 4:].abs().sum() > 0
    assert gradient[..., :3].abs().sum() == 0


def test_a_recipe_names_a_network_and_its_modules():
    parser = jsonargparse.ArgumentParser()
    parser.add_argument("--energy", type=Energy)
    recipe = """
    energy:
      class_path: kfit.energies.Perceptual
      init_args:
        network:
          class_path: kfit.features.Activations
          init_args:
            network: {class_path: torch.nn.Conv2d, init_args: {in_channels: 3, out_channels: 4, kernel_size: 3}}
            layers: [""]
            mean: [0.5, 0.5, 0.5]
            std: [0.5, 0.5, 0.5]
    """
    energy = parser.instantiate(parser.parse_string(recipe)).energy
    assert energy.prepare(torch.rand(1, 3, 8, 8))["target"][""].shape == (1, 4, 6, 6)


def test_modules_that_do_not_exist_or_never_run_are_refused():
    with pytest.raises(ValueError, match=r"layers: unknown blocks.2; the names are .*blocks.1"):
        Activations(Tokens(), ["blocks.2"])
    with pytest.raises(ValueError, match="layers must hold at least one item"):
        Activations(Tokens(), [])
    with pytest.raises(ValueError, match="layers: unused did not run"):
        Activations(Tokens(), ["unused", "blocks.0"], 1)(torch.rand(1, 3, 8, 8))


def test_outputs_that_are_no_pictures_are_refused():
    image = torch.rand(1, 3, 8, 12)
    with pytest.raises(ValueError, match=r"blocks.0 must give .* num_prefix_tokens is set, got \(1, 7, 8\)"):
        Activations(Tokens(), ["blocks.0"])(image)
    with pytest.raises(ValueError, match=r"after 0 tokens, blocks.0 leaves 7 for a picture of 8×12"):
        Activations(Tokens(), ["blocks.0"], 0)(image)
    with pytest.raises(ValueError, match=r"1 must give .* got \(1, 192\)"):
        Activations(nn.Sequential(nn.Identity(), nn.Flatten()), ["1"], 0)(torch.rand(1, 3, 8, 8))
