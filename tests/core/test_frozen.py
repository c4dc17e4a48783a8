"""A frozen twin shares its numbers and disturbs nothing."""

import pytest
import torch
from torch import nn

from kfit.core import frozen


@pytest.fixture
def network():
    torch.manual_seed(0)
    network = nn.Sequential(nn.Linear(3, 4), nn.BatchNorm1d(4), nn.Dropout(0.5), nn.Linear(4, 2))
    network[3].bias.requires_grad_(False)
    return network.train()


def test_the_twin_shares_parameters_and_buffers(network):
    twin = frozen(network)
    own, shared = network.state_dict(), twin.state_dict()
    assert own.keys() == shared.keys()
    assert all(own[name].data_ptr() == shared[name].data_ptr() for name in own)


def test_the_twin_asks_for_no_gradients_and_is_in_evaluation_mode(network):
    twin = frozen(network)
    assert not any(p.requires_grad for p in twin.parameters())
    assert all(isinstance(p, nn.Parameter) for p in twin.parameters())
    assert not any(module.training for module in twin.modules())


def test_the_original_keeps_its_flags_and_its_mode(network):
    before = {name: p.requires_grad for name, p in network.named_parameters()}
    frozen(network)
    assert {name: p.requires_grad for name, p in network.named_parameters()} == before
    assert all(module.training for module in network.modules())


def test_gradients_pass_through_the_twin_to_its_input_and_not_to_the_original(network):
    x = torch.randn(5, 3, requires_grad=True)
    frozen(network)(x).sum().backward()
    assert x.grad.abs().sum() > 0
    assert all(p.grad is None for p in network.parameters())


def test_the_twin_sees_later_training(network):
    twin, x = frozen(network), torch.randn(8, 3)
    before = twin(x)
    optimizer = torch.optim.SGD([p for p in network.parameters() if p.requires_grad], lr=0.5)
    network(x).square().sum().backward()
    optimizer.step()
    assert not torch.allclose(twin(x), before)
    torch.testing.assert_close(twin(x), network.eval()(x), rtol=0, atol=0)


def test_shared_parameters_stay_shared():
    network = nn.ModuleList([nn.Linear(2, 2), nn.Linear(2, 2)])
    network[1].weight = network[0].weight
    twin = frozen(network)
    assert twin[0].weight is twin[1].weight


@pytest.mark.parametrize("inside", ["twin", "network"])
def test_a_twin_made_in_inference_mode_can_be_fitted_outside_it(network, inside):
    with torch.inference_mode():
        if inside == "network":
            network = nn.Sequential(nn.Linear(3, 4), nn.BatchNorm1d(4), nn.Linear(4, 2))
        twin = frozen(network)
    x = torch.randn(5, 3, requires_grad=True)
    twin(x).sum().backward()
    assert x.grad.abs().sum() > 0
