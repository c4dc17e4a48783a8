"""The example energy keeps the contract: what is hidden is neither perfect nor in the way."""

import importlib.util
from pathlib import Path

import pytest
import torch

FILE = Path(__file__).parents[2] / "examples" / "own_parts" / "trimmed_l1.py"
SPEC = importlib.util.spec_from_file_location("trimmed_l1", FILE)
trimmed_l1 = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(trimmed_l1)


def pictures():
    return torch.rand(2, 2, 3, 8, 8, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def test_it_is_the_mean_of_the_least_differences():
    x, y = pictures()
    expected = (x - y).abs().flatten(1).topk(int(0.75 * 192), largest=False).values.mean(1)
    torch.testing.assert_close(trimmed_l1.TrimmedL1(0.75)(x, y), expected)


def test_hidden_pixels_count_neither_as_perfect_nor_at_all():
    x, y = pictures()
    weight = torch.ones(2, 1, 8, 8, dtype=torch.float64)
    weight[..., 4:] = 0
    energy = trimmed_l1.TrimmedL1(0.5)
    torch.testing.assert_close(energy(x, y, weight), energy(x[..., :4], y[..., :4]))


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_hidden_pixels_may_hold_anything(value):
    x, y = pictures()
    weight = (torch.rand(2, 1, 8, 8, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    energy = trimmed_l1.TrimmedL1()
    spoiled = [torch.where(weight > 0, picture, value) for picture in (x, y)]
    torch.testing.assert_close(energy(*spoiled, weight), energy(x, y, weight))
    prediction = spoiled[0].requires_grad_()
    slope = torch.autograd.grad(energy(prediction, spoiled[1], weight).sum(), prediction)[0]
    assert slope.isfinite().all()
    assert slope[(weight == 0).expand_as(slope)].abs().max() == 0
