"""Crops of training: framed by the outline, turned, and partly hidden."""

import math

import pytest
import torch

from kfit.geometry import Crop
from kfit.training import RandomCrop
from kfit.training.random_crop import crop_rolled


def bar(size=40):
    """A dark bar from (8, 18) to (31, 21), its right end red."""
    image, mask = torch.ones(1, 3, size, size), torch.zeros(1, 1, size, size)
    image[..., 18:22, 8:32], mask[..., 18:22, 8:32] = 0.2, 1
    image[:, 0, 18:22, 26:32] = 1.0
    return image, mask


def test_without_a_roll_it_is_the_crop_of_a_photo():
    image, mask = bar()
    photo = Crop.around(mask[0, 0], 32).cut(image[0].movedim(0, -1), mask[0, 0])
    found = crop_rolled(image, mask, torch.zeros(1), 32)
    assert (found - photo.image).abs().mean() < 0.02


def test_a_quarter_turn_is_anticlockwise_and_framed_anew():
    image, mask = bar()
    found = crop_rolled(image, mask, torch.tensor([math.pi / 2]), 32)
    torch.testing.assert_close(found, crop_rolled(image, mask, torch.zeros(1), 32).rot90(1, (2, 3)), rtol=0, atol=0.02)
    dark = found[0, 1] < 0.6
    assert dark.any(1).sum() == pytest.approx(32 / 1.3, abs=2)


@pytest.mark.parametrize("roll", [0.3, 1.0, 2.5, -2.0])
def test_the_outline_fills_the_same_share_at_every_roll(roll):
    dark = crop_rolled(*bar(), torch.tensor([roll]), 64)[0, 1] < 0.6
    longer = max(int(dark.any(0).sum()), int(dark.any(1).sum()))
    assert longer == pytest.approx(64 / 1.3, abs=3)


def test_half_of_the_rolls_are_near_zero_and_the_others_anywhere():
    torch.manual_seed(0)
    image, mask = (part.expand(2000, -1, -1, -1) for part in bar())
    _, roll = RandomCrop(8)(image, mask)
    assert 0.52 < float((roll.abs() < math.radians(30)).double().mean()) < 0.64
    assert float((roll.abs() > math.pi / 2).double().mean()) == pytest.approx(0.25, abs=0.04)


def test_a_share_of_the_objects_has_a_side_hidden():
    torch.manual_seed(0)
    image, mask = (part.expand(400, -1, -1, -1) for part in bar())
    crop = RandomCrop(hidden=0.5, covered=0.0)
    kept = crop._hide(image, mask)[1].sum((1, 2, 3)) / mask.sum((1, 2, 3))
    assert float((kept < 1).double().mean()) == pytest.approx(0.45, abs=0.1)
    assert kept.min() > 0.5
    assert torch.equal(RandomCrop(hidden=0.0, covered=0.0)._hide(image, mask)[1], mask)


def test_a_share_of_the_objects_has_something_in_front():
    torch.manual_seed(0)
    image, mask = (part.expand(400, -1, -1, -1) for part in bar())
    shown, visible = RandomCrop(hidden=0.0, covered=0.5)._hide(image, mask)
    kept = visible.sum((1, 2, 3)) / mask.sum((1, 2, 3))
    assert float((kept < 1).double().mean()) == pytest.approx(0.5, abs=0.08)
    assert kept.min() > 0.55
    assert shown[(visible < mask).expand_as(shown)].eq(1).all()


def test_an_empty_mask_gives_a_finite_crop():
    image, mask = bar()
    assert crop_rolled(image, 0 * mask, torch.zeros(1), 16).isfinite().all()


@pytest.mark.parametrize("settings", [{"size": 0}, {"shift": 0.6}, {"scale": 0.5}, {"hidden": 2.0}, {"covered": -0.1}])
def test_a_setting_out_of_range_is_an_error(settings):
    with pytest.raises(ValueError, match=f"RandomCrop: {next(iter(settings))}"):
        RandomCrop(**settings)
