from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.distributions import Categorical, kl_divergence

from kfit.generators import PoseHead


def test_gives_log_probabilities_over_even_bins_of_the_valid_poses() -> None:
    head = PoseHead()
    said = head(torch.rand(2, 3, 64, 64))
    assert said.shape == (2, 36, 9)
    torch.testing.assert_close(said.exp().sum((1, 2)), torch.ones(2))
    torch.testing.assert_close(head.azimuths.rad2deg(), torch.arange(-175.0, 180, 10))
    torch.testing.assert_close(head.elevations.rad2deg(), torch.arange(-10.0, 75, 10))
    assert 1.1e6 < sum(p.numel() for p in head.parameters()) < 1.3e6


def test_the_divergence_is_that_of_torch_from_a_von_mises_times_a_gaussian() -> None:
    head = PoseHead(spread_deg=8.0)
    said = torch.randn(3, 36, 9).flatten(1).log_softmax(1).view(3, 36, 9)
    azimuth, elevation = torch.tensor([0.1, 3.1, -2.0]), torch.tensor([0.2, 1.0, -0.2])
    width = math.radians(8)
    turned = torch.distributions.VonMises(azimuth[:, None], torch.tensor(1 / width**2)).log_prob(head.azimuths)
    tipped = torch.distributions.Normal(elevation[:, None], width).log_prob(head.elevations)
    target = Categorical(logits=(turned[:, :, None] + tipped[:, None]).flatten(1))
    expected = kl_divergence(target, Categorical(logits=said.flatten(1)))
    torch.testing.assert_close(head.divergence(said, azimuth, elevation), expected, rtol=1e-4, atol=1e-5)


def test_the_divergence_is_the_same_a_turn_further_and_least_at_the_truth() -> None:
    head = PoseHead()
    truth = torch.tensor([math.radians(178)])
    flat = torch.zeros(1, 36, 9)
    across = flat.clone()
    across[0, 0, 4] = 4.0  # −175° is 7° from 178°
    away = flat.clone()
    away[0, 18, 4] = 4.0
    at = torch.tensor([head.elevations[4]])

    def divergence(logits: Tensor, azimuth: Tensor) -> float:
        return float(head.divergence(logits.flatten(1).log_softmax(1).view(1, 36, 9), azimuth, at))

    assert divergence(across, truth) < divergence(flat, truth) < divergence(away, truth)
    assert divergence(across, truth) == pytest.approx(divergence(across, truth - 2 * math.pi), abs=1e-4)


def test_a_symmetric_category_is_not_punished_for_azimuth() -> None:
    head = PoseHead("y")
    said = head(torch.rand(4, 3, 64, 64))
    assert said.shape == (4, 1, 9)
    elevation = torch.full((4,), 0.5)
    some, others = (head.divergence(said, torch.linspace(a, a + 3, 4), elevation) for a in (-3.0, 0.5))
    torch.testing.assert_close(some, others)


def test_learns_what_it_sees_and_says_so_where_two_poses_look_alike() -> None:
    torch.manual_seed(0)
    head = PoseHead(channels=(8, 8), hidden_dim=32, bin_deg=30.0, spread_deg=15.0, image_size=16)
    pictures = torch.rand(2, 3, 16, 16)[[0, 0, 1]]
    azimuth, elevation = torch.tensor([0.25, 2.9, -1.3]), torch.full((3,), 0.5)
    adam = torch.optim.Adam(head.parameters(), 1e-2)
    for _ in range(80):
        adam.zero_grad()
        head.divergence(head(pictures), azimuth, elevation).mean().backward()
        adam.step()
    share = head(pictures).exp().sum(2)
    near = [share[0, (head.azimuths - a).abs() < 0.6].sum().item() for a in (0.25, 2.9)]
    assert near == pytest.approx([0.5, 0.5], abs=0.08)
    assert share[2, (head.azimuths + 1.3).abs() < 0.6].sum() > 0.8


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "z"}, "PoseHead: symmetry must be 'none' or 'y', got 'z'"),
        ({"bin_deg": 0.5}, "PoseHead: bin_deg must lie between 1 and 90"),
        ({"spread_deg": 0.0}, "PoseHead: spread_deg must lie between"),
        ({"elevation_deg": (30.0, 20.0)}, "PoseHead: elevation_deg must rise within"),
    ],
)
def test_refuses_bins_that_are_none(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        PoseHead(**settings)
