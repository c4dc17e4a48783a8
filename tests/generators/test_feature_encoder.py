"""The encoder that looks through a fixed network."""

import torch

from kfit.generators import FeatureEncoder


def encoder():
    torch.manual_seed(0)
    return FeatureEncoder(code_dim=5, feature_dim=4, hidden_dim=8)


def test_gives_mean_and_log_variance_of_each_picture_alone():
    torch.manual_seed(0)
    image, network = torch.rand(3, 3, 64, 64), encoder()
    for part, alone in zip(network(image), network(image[1:2]), strict=True):
        assert part.shape == (3, 5)
        torch.testing.assert_close(part[1:2], alone)
    assert bool((network(image)[1] < -2).all())


def test_trains_what_follows_the_fixed_network_and_nothing_of_it():
    network = encoder().train()
    sum(part.sum() for part in network(torch.rand(2, 3, 64, 64))).backward()
    learned = {name for name, p in network.named_parameters() if p.requires_grad}
    assert all(name.startswith(("reduce", "shape", "color", "output")) for name in learned)
    assert all(p.grad is not None for p in network.parameters() if p.requires_grad)
    assert not network.features.training


def test_tells_colours_apart_whose_features_are_alike():
    class Blind(torch.nn.Module):
        def forward(self, image):
            return {"none": torch.zeros(len(image), 2, 4, 4)}

    network = FeatureEncoder(code_dim=5, features=Blind(), feature_dim=4, hidden_dim=8)
    grey = torch.full((1, 3, 64, 64), 0.5)
    red = grey + torch.tensor([0.1, -0.05, -0.05]).view(1, 3, 1, 1)
    assert not torch.allclose(network(grey)[0], network(red)[0], atol=1e-3)


def test_speaks_in_full_precision_under_autocast():
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mean, log_variance = encoder()(torch.rand(2, 3, 64, 64))
    assert mean.dtype == log_variance.dtype == torch.float32
