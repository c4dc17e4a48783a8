"""The network that reads object coordinates: what it gives, and its loss with and without a free turn."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.baselines import CoordinateRegressor
from kfit.geometry import rotation_from_angles

SMALL = {"channels": (4, 8, 8), "num_bins": 8}


def logits_for(regressor: CoordinateRegressor, coordinates: Tensor, strength: float = 30.0) -> Tensor:
    bins = ((coordinates + 0.5) * regressor.num_bins).long()
    return strength * F.one_hot(bins, regressor.num_bins).movedim(-1, 2).float()


def test_gives_logits_of_even_bins_for_each_axis_and_pixel() -> None:
    regressor = CoordinateRegressor()
    assert regressor(torch.rand(2, 3, 64, 64)).shape == (2, 3, 32, 64, 64)
    torch.testing.assert_close(regressor.centres, torch.linspace(-0.5 + 1 / 64, 0.5 - 1 / 64, 32))
    assert 1.6e6 < sum(p.numel() for p in regressor.parameters()) < 1.8e6


def test_coordinates_are_the_mean_over_the_likeliest_bin_and_its_neighbours(monkeypatch) -> None:
    regressor = CoordinateRegressor(**SMALL)
    share = torch.tensor([0.0, 0.1, 0.4, 0.2, 0.0, 0.0, 0.0, 0.3])
    logits = share.log().clamp_min(-50).view(1, 1, 8, 1, 1).expand(1, 3, 8, 2, 2)
    monkeypatch.setattr(regressor, "forward", lambda image: logits)
    found = regressor.coordinates(torch.rand(1, 3, 2, 2))
    # Bins 1, 2 and 3 have centres −5/16, −3/16 and −1/16; the far peak does not pull.
    expected = (0.1 * -5 / 16 + 0.4 * -3 / 16 + 0.2 * -1 / 16) / 0.7
    torch.testing.assert_close(found, torch.full((1, 3, 2, 2), expected))


def test_the_loss_is_torch_s_cross_entropy_over_the_object() -> None:
    regressor = CoordinateRegressor(**SMALL)
    logits, truth = torch.randn(2, 3, 8, 4, 4), torch.rand(2, 3, 4, 4) - 0.5
    mask = (torch.rand(2, 1, 4, 4) > 0.4).float()
    bins = ((truth + 0.5) * 8).floor().long()
    each = F.cross_entropy(logits.flatten(0, 1), bins.flatten(0, 1), reduction="none").view(2, 3, 4, 4)
    expected = torch.stack([each[n][:, mask[n, 0] > 0.5].mean() for n in range(2)])
    torch.testing.assert_close(regressor.divergence(logits, truth, mask), expected)


def test_nothing_known_costs_nothing() -> None:
    regressor = CoordinateRegressor(**SMALL)
    loss = regressor.divergence(torch.randn(1, 3, 8, 4, 4), torch.zeros(1, 3, 4, 4), torch.zeros(1, 1, 4, 4))
    assert loss.tolist() == [0.0]


def test_a_free_turn_costs_nothing_where_it_is_one_for_the_whole_object() -> None:
    truth = 0.6 * (torch.rand(1, 3, 6, 6) - 0.5)
    mask = torch.ones(1, 1, 6, 6)
    turn = rotation_from_angles(torch.tensor(math.radians(120)), torch.tensor(0.0), torch.tensor(0.0))
    rotated = torch.einsum("ij,njhw->nihw", turn, truth)
    free, fixed = CoordinateRegressor("y", **SMALL), CoordinateRegressor(**SMALL)
    logits = logits_for(free, rotated)
    assert free.divergence(logits, truth, mask).item() < 1e-3
    assert fixed.divergence(logits, truth, mask).item() > 5
    half = torch.cat([rotated[..., :3], truth[..., 3:]], -1)
    assert free.divergence(logits_for(free, half), truth, mask).item() > 2


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "x"}, "symmetry must be one of none, y, y2"),
        ({"num_bins": 1}, "num_bins must be at least 2"),
    ],
)
def test_refuses_what_it_cannot_be(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        CoordinateRegressor(**settings)


def test_refuses_pictures_that_do_not_halve() -> None:
    with pytest.raises(ValueError, match=r"image: sides must be multiples of 4, got \(18, 18\)"):
        CoordinateRegressor(**SMALL)(torch.rand(1, 3, 18, 18))
