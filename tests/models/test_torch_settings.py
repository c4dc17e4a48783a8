"""What a caller has set in torch neither breaks loading and posing, nor is changed by them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch

import kfit
from kfit.pose import CategoryModel, PoseResult

RNG = np.random.default_rng(0)
IMAGE, MASK = RNG.random((70, 80, 3)), np.zeros((70, 80))
MASK[5:60, 10:75] = 1


def pose(model: CategoryModel) -> PoseResult:
    return model.pose(IMAGE, mask=MASK, pipeline=model.pipeline(2, 2))


@pytest.fixture(scope="module")
def expected() -> PoseResult:
    return pose(kfit.load("mug"))


@contextmanager
def double_by_default() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("around", [double_by_default, pytest.param(torch.inference_mode, marks=pytest.mark.slow)])
def test_loading_and_posing_give_the_same_answer_inside(around, expected: PoseResult) -> None:
    with around():
        model = kfit.load("mug")
        inside = pose(model)
    for found in (inside, pose(model)):
        np.testing.assert_allclose(found.rotation, expected.rotation, atol=2e-3)
        assert found.energy == pytest.approx(expected.energy, rel=2e-3)
    assert {parameter.dtype for parameter in model.generator.parameters()} == {torch.float32}
    assert inside.fit.values["code"].dtype == torch.float32


def test_loading_and_posing_leave_torch_s_random_numbers_as_they_are() -> None:
    before = torch.random.get_rng_state()
    pose(kfit.load("mug"))
    assert torch.equal(torch.random.get_rng_state(), before)


@pytest.mark.parametrize("name", ["VGG16", "AlexNet", "EfficientNetLite0"])
def test_a_feature_network_takes_pictures_of_any_precision(name: str, tmp_path) -> None:
    from kfit import features

    kind = getattr(features, name)
    if name != "EfficientNetLite0":
        layer = "relu1_1" if name == "VGG16" else "relu1"
        shape = (64, 3, 3, 3) if name == "VGG16" else (64, 3, 11, 11)
        torch.save({"features.0.weight": torch.randn(shape), "features.0.bias": torch.randn(64)}, tmp_path / "w.pth")
        arguments = {"layers": [layer], "weights": str(tmp_path / "w.pth")}
    else:
        arguments = {"layers": [1]}
    picture = torch.rand(1, 3, 64, 64)
    (single,) = kind(**arguments)(picture).values()
    with double_by_default():
        (found,) = kind(**arguments)(picture.double()).values()
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, single)
