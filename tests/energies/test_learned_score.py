"""The learned score: the log-odds of a network as an energy."""

import math

import torch

from kfit.energies import LearnedScore
from kfit.geometry import PoseUpdate, RefinerNetwork


class Brightness(RefinerNetwork):
    """Finds a drawing the likelier the nearer its mean is to the photo's."""

    def forward(self, observed, drawn):
        off = (observed - drawn).mean((1, 2, 3)).abs()
        zeros = off.new_zeros(len(off), 4)
        return PoseUpdate(zeros[:, :3], zeros[:, :2], zeros[:, 0], zeros, 2 - 10 * off)


def pictures(value, rows=3):
    return {"image": torch.full((rows, 3, 8, 8), value), "mask": torch.ones(rows, 1, 8, 8)}


def test_is_the_cross_entropy_of_a_right_pose():
    found = LearnedScore(Brightness())(pictures(0.4), pictures(0.4))
    torch.testing.assert_close(found, torch.full((3,), math.log1p(math.exp(-2))))


def test_ranks_what_the_network_finds_right_first():
    score = LearnedScore(Brightness())
    assert (score(pictures(0.4), pictures(0.4)) < score(pictures(0.6), pictures(0.4))).all()


def test_counts_nothing_where_the_weight_is_zero():
    score, target, drawn = LearnedScore(Brightness()), pictures(0.4), pictures(0.5)
    weight = torch.ones(3, 1, 8, 8)
    weight[..., :4] = 0
    expected = score(drawn, target, weight)
    for picture in (drawn, target):
        picture["image"][..., :4] = torch.nan
        picture["mask"][..., :4] = 0.3
    torch.testing.assert_close(score(drawn, target, weight), expected)


def test_has_a_gradient():
    image = torch.full((1, 3, 8, 8), 0.5, requires_grad=True)
    found = LearnedScore(Brightness())({"image": image, "mask": torch.ones(1, 1, 8, 8)}, pictures(0.4, 1))
    assert torch.autograd.grad(found.sum(), image)[0].abs().sum() > 0
