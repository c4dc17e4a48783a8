"""The network that compares photos with drawings."""

import pytest
import torch
from safetensors.torch import save_file

from kfit.features import PoseRefiner


def pictures(rows=2, side=64):
    return torch.rand(rows, 4, side, side, generator=torch.Generator().manual_seed(0))


def test_predicts_an_update_with_its_spread_and_a_logit_for_each_row():
    found = refiner()(pictures(), pictures())
    assert [tuple(tensor.shape) for tensor in found] == [(2, 3), (2, 2), (2,), (2, 4), (2,)]
    assert all(tensor.isfinite().all() for tensor in found)


def refiner():
    """One whose last layer is random, so that it answers something."""
    torch.manual_seed(0)
    made = PoseRefiner(None, channels=(4, 4), hidden_dim=8).eval()
    torch.nn.init.normal_(made.out.weight)
    return made


def test_an_untrained_one_leaves_the_pose():
    found = PoseRefiner(None, channels=(4, 4)).eval()(pictures(), pictures())
    assert found.rotation.abs().max() == found.shift.abs().max() == found.log_scale.abs().max() == 0
    assert torch.equal(found.logit, torch.zeros(2))


def test_pictures_of_another_size_are_resized():
    small = PoseRefiner(None, channels=(4, 4), image_size=16).eval()
    assert small(pictures(side=40), pictures(side=40)).rotation.shape == (2, 3)


def test_rows_are_independent_of_one_another():
    network, photos = refiner(), pictures(3)
    together, alone = network(photos, photos.flip(2)), network(photos[1:2], photos[1:2].flip(2))
    torch.testing.assert_close(together.rotation[1:2], alone.rotation)


def test_weights_of_another_size_are_refused(tmp_path):
    file = str(tmp_path / "refiner.safetensors")
    save_file(refiner().state_dict(), file)
    with pytest.raises(ValueError, match=r"refiner\.safetensors' are of another network than these settings"):
        PoseRefiner(file, channels=(4, 8))


def test_weights_come_from_a_file_or_a_checkpoint(tmp_path):
    small = {"channels": (4, 4), "hidden_dim": 8, "image_size": 16}
    trained = PoseRefiner(None, **small)
    torch.nn.init.normal_(trained.out.weight)
    save_file(trained.state_dict(), tmp_path / "refiner.safetensors")
    state = {f"refiner.{name}": value for name, value in trained.state_dict().items()}
    torch.save({"state_dict": state}, tmp_path / "last.ckpt")
    for name in ("refiner.safetensors", "last.ckpt"):
        again = PoseRefiner(str(tmp_path / name), **small)
        assert torch.equal(again.out.weight, trained.out.weight)


def test_a_file_that_holds_no_refiner_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no weights at"):
        PoseRefiner(weights=str(tmp_path / "none.ckpt"))
    (tmp_path / "wrong.safetensors").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="holds no weights of a refiner"):
        PoseRefiner(weights=str(tmp_path / "wrong.safetensors"))
