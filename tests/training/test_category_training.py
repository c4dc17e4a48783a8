import numpy as np
import pytest
import torch

from kfit.features.category_classifier import NAMES
from kfit.training.category_scenes import SIDE, empty_scene, object_scene, other_scene
from kfit.training.category_training import crop, solve


@pytest.mark.parametrize("make", [lambda rng: object_scene("bowl", 3, rng), other_scene, empty_scene])
def test_a_scene_depends_on_its_random_numbers_alone(make):
    scene, again = make(np.random.default_rng(4)), make(np.random.default_rng(4))
    assert scene.image.shape == (SIDE, SIDE, 3)
    assert scene.image.dtype == np.uint8
    np.testing.assert_array_equal(scene.image, again.image)
    assert (scene.box[:2] >= 0).all()
    assert (scene.box[2:] <= SIDE).all()
    assert (scene.box[2:] > scene.box[:2]).all()
    assert crop(scene, np.random.default_rng(0)).shape == (3, 224, 224)


def test_other_things_are_all_drawn_once_in_a_while():
    for seed in range(6):
        assert np.ptp(other_scene(np.random.default_rng(seed)).image) > 20


def test_the_solution_tells_separable_classes_and_trusts_a_good_prior():
    generator = torch.Generator().manual_seed(0)
    targets = torch.arange(len(NAMES)).repeat(20)
    features = torch.nn.functional.one_hot(targets, 12).float() + 0.1 * torch.rand(140, 12, generator=generator)
    weight, bias, trust = solve(features, torch.zeros(140, len(NAMES)), targets, 1e-3)
    assert ((features @ weight.T + bias).argmax(1) == targets).all()
    prior = 3 * torch.nn.functional.one_hot(targets, len(NAMES)).float()
    weight, bias, trust = solve(torch.rand(140, 12, generator=generator), prior, targets, 1.0)
    assert trust > 1
    assert weight.abs().max() < 0.1
