"""The disturbances of the paper's robustness study, at one strength and at random."""

import pytest
import torch

from kfit.training import RandomCorruption
from kfit.training.random_corruption import brightened, occluded, shifted

SIDE = 32


def discs(rows=6):
    """Grey discs on white with soft edges."""
    place = torch.arange(SIDE) - (SIDE - 1) / 2
    mask = (10.5 - torch.hypot(place[:, None], place)).clamp(0, 1).expand(rows, 1, SIDE, SIDE)
    colour = torch.rand(rows, 3, 1, 1, generator=torch.Generator().manual_seed(3))
    return colour * mask + 1 - mask, mask


class TestOcclusion:
    @pytest.mark.parametrize("share", [0.0, 0.2, 0.55, 1.0])
    def test_takes_just_the_share_of_each_object(self, share):
        image, mask = discs()
        hidden, left = occluded(image, mask, share)
        kept = left.sum((1, 2, 3)) / mask.sum((1, 2, 3))
        torch.testing.assert_close(kept, torch.full((6,), 1 - share), atol=0.003, rtol=0)
        if share == 0:
            assert torch.equal(left, mask)
        torch.testing.assert_close(hidden, image.where(left == mask, 1))

    def test_takes_one_piece_that_is_as_wide_as_high(self):
        _, mask = discs(40)
        _, left = occluded(1 - mask.expand(-1, 3, -1, -1), mask, 0.1, torch.Generator().manual_seed(1))
        inner = 0
        for before, after in zip(mask, left, strict=True):
            _, rows, columns = (before != after).nonzero(as_tuple=True)
            high, wide = int(rows.max() - rows.min()) + 1, int(columns.max() - columns.min()) + 1
            # A square that does not reach over the edge is filled but for its last ring.
            if len(rows) >= (max(high, wide) - 2) ** 2 and abs(high - wide) <= 1:
                inner += 1
        assert inner > 10

    def test_takes_shares_of_their_own_and_repeats_itself_by_the_generator(self):
        image, mask = discs()
        shares = torch.linspace(0, 1, 6)
        _, left = occluded(image, mask, shares, torch.Generator().manual_seed(2))
        kept = left.sum((1, 2, 3)) / mask.sum((1, 2, 3))
        torch.testing.assert_close(kept, 1 - shares, atol=0.003, rtol=0)
        assert torch.equal(left, occluded(image, mask, shares, torch.Generator().manual_seed(2))[1])
        assert not torch.equal(left, occluded(image, mask, shares, torch.Generator().manual_seed(4))[1])


class TestBrightness:
    def test_multiplies_the_object_and_leaves_the_ground_white(self):
        image, mask = discs()
        inside, outside = mask.expand(-1, 3, -1, -1) == 1, mask.expand(-1, 3, -1, -1) == 0
        for factor in (0.0, 0.6, 1.4, 3.0):
            found = brightened(image, mask, factor)
            torch.testing.assert_close(found[inside], (factor * image[inside]).clamp(max=1))
            assert bool((found[outside] == 1).all())

    def test_is_what_would_be_blended_from_the_brighter_object(self):
        _, mask = discs()
        colour = torch.rand(6, 3, SIDE, SIDE)
        factor = torch.linspace(0.5, 2, 6)
        expected = (factor.view(6, 1, 1, 1) * colour).clamp(max=1) * mask + 1 - mask
        torch.testing.assert_close(brightened(colour * mask + 1 - mask, mask, factor), expected)

    def test_of_one_changes_nothing(self):
        image, mask = discs()
        torch.testing.assert_close(brightened(image, mask, 1.0), image)


class TestShift:
    def test_by_whole_pixels_is_torch_s_roll_right_and_up_with_white_coming_in(self):
        image, mask = torch.rand(2, 3, SIDE, SIDE), torch.rand(2, 1, SIDE, SIDE)
        moved, moved_mask = shifted(image, mask, torch.tensor([[0.25, 0.0], [0.0, 0.25]]))
        torch.testing.assert_close(moved[0, :, :, 8:], image[0, :, :, :-8], atol=1e-4, rtol=0)
        torch.testing.assert_close(moved_mask[1, :, :-8], mask[1, :, 8:], atol=1e-4, rtol=0)
        torch.testing.assert_close(moved[1, :, -8:], torch.ones(3, 8, SIDE), atol=1e-4, rtol=0)
        torch.testing.assert_close(moved_mask[0, :, :, :8], torch.zeros(1, SIDE, 8), atol=1e-4, rtol=0)


class TestRandomCorruption:
    def test_stays_within_its_ranges_and_fills_them(self, monkeypatch):
        inputs = {}
        steps = {
            "occluded": lambda image, mask, share, rng: inputs.update(share=share) or (image, mask),
            "brightened": lambda image, mask, factor: inputs.update(factor=factor) or image,
            "shifted": lambda image, mask, offset: inputs.update(offset=offset) or (image, mask),
        }
        for name, step in steps.items():
            monkeypatch.setattr(f"kfit.training.random_corruption.{name}", step)
        RandomCorruption()(torch.ones(4000, 3, 1, 1), torch.ones(4000, 1, 1, 1))
        length, turn = inputs["offset"].norm(dim=1), torch.atan2(*inputs["offset"].unbind(1))
        ranges = ((inputs["share"], 0, 0.2), (inputs["factor"], 0.6, 1.4), (length, 0, 0.25), (turn, -3.1416, 3.1416))
        for value, low, high in ranges:
            assert low - 1e-6 <= value.min() < low + 0.01 * (high - low)
            assert high - 0.01 * (high - low) < value.max() <= high + 1e-6
            assert abs(float(value.mean()) - (low + high) / 2) < 0.03 * (high - low)

    def test_of_nothing_gives_the_picture_itself(self):
        image, mask = discs()
        found = RandomCorruption(0.0, 0.0, 0.0)(image, mask)
        torch.testing.assert_close(found, (image, mask), atol=1e-4, rtol=0)

    def test_disturbs_each_picture_its_own_way_and_repeats_itself_by_the_generator(self):
        image, mask = (part[:1].expand(5, -1, -1, -1) for part in discs())
        first, again = (RandomCorruption()(image, mask, torch.Generator().manual_seed(7))[0] for _ in range(2))
        assert torch.equal(first, again)
        assert len(first.flatten(1).unique(dim=0)) == 5

    @pytest.mark.parametrize("settings", [{"occlusion": 1.1}, {"brightness": -0.1}, {"shift": 2.0}])
    def test_refuses_ranges_that_are_none_by_name(self, settings):
        with pytest.raises(ValueError, match=f"RandomCorruption: {next(iter(settings))} must lie between"):
            RandomCorruption(**settings)
