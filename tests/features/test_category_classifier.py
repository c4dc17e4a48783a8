import numpy as np
import torch
from skimage.data import cat, coffee

from kfit.features.category_classifier import IMAGENET, NAMES, CategoryClassifier, grouped, object_square

CUP = np.array([172.0, 18.0, 403.0, 306.0])


def probabilities(image, box):
    with torch.no_grad():
        return CategoryClassifier()(object_square(image.astype(np.float32) / 255, box, 0.15)[None]).exp()[0]


def test_the_cup_of_coffee_is_a_mug_and_the_cat_is_nothing():
    of_cup, of_cat = probabilities(coffee(), CUP), probabilities(cat(), np.array([60.0, 20.0, 400.0, 280.0]))
    assert of_cup[NAMES.index("mug")] > 0.8
    assert of_cat[NAMES.index("none")] > 0.8
    torch.testing.assert_close(of_cup.sum(), torch.tensor(1.0))


def test_groups_hold_each_class_of_imagenet_once():
    classes = [number for group in IMAGENET.values() for number in group]
    assert len(set(classes)) == len(classes)
    uniform = grouped(torch.zeros(1, 1000)).exp()[0]
    assert uniform[NAMES.index("bowl")].round() == 2
    assert uniform.sum().round() == 1000


def test_a_square_beyond_the_picture_repeats_its_border():
    image = np.zeros((50, 100, 3), np.float32)
    image[:, 50:] = 1
    found = object_square(image, np.array([80.0, 10.0, 100.0, 40.0]), 0.5)
    assert found.shape == (3, 224, 224)
    assert found[0, :, 0].mean() == 1
    whole = object_square(image, np.array([0.0, 0.0, 100.0, 50.0]), 0.0)
    assert whole[0, 112, 20] == 0
    assert whole[0, 112, 200] == 1
    assert whole[0, 0, 200] == 1
