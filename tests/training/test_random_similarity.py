"""Views turned, moved and enlarged at random, with their masks."""

import math

import pytest
import torch

from kfit.training import RandomSimilarity


class TestRandomSimilarity:
    def test_of_nothing_gives_the_picture_itself(self):
        image = torch.rand(5, 3, 32, 32)
        torch.testing.assert_close(RandomSimilarity(0.0, 0.0, 1.0)(image), image, rtol=0, atol=2e-5)

    def test_stays_within_its_range_and_fills_it(self, monkeypatch):
        inputs = {}
        monkeypatch.setattr(
            "kfit.training.random_similarity.warp", lambda drawn, **values: inputs.update(values) or drawn
        )
        torch.manual_seed(0)
        RandomSimilarity(30.0, 0.2, 1.5)(torch.ones(4000, 3, 1, 1))
        roll, shift, scale = inputs["roll"].rad2deg(), inputs["shift"], inputs["scale"]
        for value, most in ((roll, 30), (shift, 0.2), (scale.log(), math.log(1.5))):
            assert value.abs().max() <= most * (1 + 1e-6)
            assert value.max() > 0.99 * most
            assert value.min() < -0.99 * most
            assert abs(float(value.mean())) < 0.03 * most
        assert shift.shape == (4000, 2)

    def test_moves_each_picture_its_own_way_on_white(self):
        torch.manual_seed(0)
        image = torch.zeros(1, 3, 32, 32).expand(3, 3, 32, 32)
        jittered = RandomSimilarity(0.0, 0.4, 1.0)(image)
        assert jittered.shape == (3, 3, 32, 32)
        assert len(jittered.flatten(1).unique(dim=0)) == 3
        assert jittered.max() == 1

    def test_takes_its_numbers_from_torch(self):
        image = torch.rand(3, 3, 16, 16)
        torch.manual_seed(5)
        first = RandomSimilarity()(image)
        torch.manual_seed(5)
        assert torch.equal(RandomSimilarity()(image), first)

    @pytest.mark.parametrize("settings", [{"roll_deg": -1.0}, {"shift": -0.1}, {"scale": 0.9}])
    def test_refuses_ranges_that_are_none_by_name(self, settings):
        with pytest.raises(ValueError, match=f"RandomSimilarity: {next(iter(settings))} must lie between"):
            RandomSimilarity(**settings)
