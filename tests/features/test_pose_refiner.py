"""The network that compares photos with drawings."""

import pytest
import torch

from kfit.features import PoseRefiner
from kfit.features.pose_refiner import WEIGHTS


def pictures(rows=2, side=64):
    return torch.rand(rows, 4, side, side, generator=torch.Generator().manual_seed(0))


def test_bundled_weights_are_small_and_load():
    assert WEIGHTS.stat().st_size < 9_000_000
    found = PoseRefiner().eval()(pictures(), pictures())
    assert [tuple(tensor.shape) for tensor in found] == [(2, 3), (2, 2), (2,), (2, 4), (2,)]
    assert all(tensor.isfinite().all() for tensor in found)


def test_an_untrained_one_leaves_the_pose():
    found = PoseRefiner(channels=(4, 4), pretrained=False).eval()(pictures(), pictures())
    assert found.rotation.abs().max() == found.shift.abs().max() == found.log_scale.abs().max() == 0
    assert torch.equal(found.logit, torch.zeros(2))


def test_pictures_of_another_size_are_resized():
    refiner = PoseRefiner(channels=(4, 4), image_size=16, pretrained=False).eval()
    assert refiner(pictures(side=40), pictures(side=40)).rotation.shape == (2, 3)


def test_rows_are_independent_of_one_another():
    refiner, photos = PoseRefiner().eval(), pictures(3)
    together, alone = refiner(photos, photos.flip(2)), refiner(photos[1:2], photos[1:2].flip(2))
    torch.testing.assert_close(together.rotation[1:2], alone.rotation)


def test_pretrained_weights_of_another_size_are_refused():
    with pytest.raises(ValueError, match="pretrained weights are those of the default settings alone"):
        PoseRefiner(hidden_dim=8)
