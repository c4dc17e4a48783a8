"""Views made to look like cut-outs of photos."""

import pytest
import torch

from kfit.training import PhotometricAugmentation
from tests.training.test_random_corruption import discs

ROWS = 64


def shot(**settings):
    torch.manual_seed(0)
    image, mask = discs(ROWS)
    nothing = {"exposure": 0.0, "cast": 0.0, "blur": 0.0, "noise": 0.0, "edge": 0.0}
    return image, mask, PhotometricAugmentation(**(nothing | settings))(image, mask)


def changed(image, other):
    return (image - other).abs().amax((1, 2, 3)) > 0.02


def test_about_half_of_the_pictures_stay_exactly_as_they_are():
    image, mask = discs(ROWS)
    torch.manual_seed(0)
    same = (PhotometricAugmentation()(image, mask) == image).flatten(1).all(1)
    assert 0.3 < same.float().mean() < 0.7


def test_pictures_stay_in_range_and_white_far_from_the_object():
    image, mask, found = shot(exposure=1.0, cast=0.5, blur=2.0, noise=0.3, edge=1.0)
    assert found.shape == image.shape
    assert 0 <= found.min() <= found.max() <= 1
    far = torch.nn.functional.max_pool2d(mask, 7, 1, 3).expand_as(image) == 0
    assert bool((found[far] == 1).all())
    assert torch.isfinite(found).all()


def test_exposure_keeps_hue_and_a_cast_does_not():
    for setting, hue_kept in (("exposure", True), ("cast", False)):
        image, _, found = shot(**{setting: 0.3})
        before, after = image[:, :, 16, 16], found[:, :, 16, 16]
        gains = (after / before)[changed(image, found) & (after.amax(1) < 1)]
        assert len(gains) > 5
        assert bool((gains.std(1) < 1e-4).all()) is hue_kept


def test_noise_and_blur_touch_the_inside_as_a_camera_does():
    image, mask, found = shot(noise=0.1)
    inside = (found - image)[:, :, 12:20, 12:20]
    assert 0.01 < inside.std() < 0.1
    assert abs(inside.mean()) < 0.01
    stripes = image.clone()
    stripes[:, :, ::2] = mask[:, :, ::2] * 0.2 + 1 - mask[:, :, ::2]
    torch.manual_seed(0)
    blurred = PhotometricAugmentation(0, 0, 2.0, 0, 0)(stripes, mask)
    rough = [(x[:, :, 13:19, 16] - x[:, :, 12:18, 16]).abs().mean((1, 2)) for x in (stripes, blurred)]
    assert bool((rough[1] <= rough[0] + 1e-6).all())
    assert rough[1].mean() < 0.9 * rough[0].mean()


def test_edges_take_in_surroundings_and_lose_parts_of_the_object():
    image, mask, found = shot(edge=0.3)
    ring = torch.nn.functional.max_pool2d(mask, 3, 1, 1) - (-torch.nn.functional.max_pool2d(-mask, 3, 1, 1))
    apart = (found - image).abs().amax(1, keepdim=True)
    assert apart[ring == 0].max() < 0.02
    outside, inside = apart[(mask < 0.05) & (ring > 0)], apart[(mask > 0.95) & (ring > 0)]
    assert outside.max() > 0.2
    assert inside.max() > 0.2


def test_random_numbers_are_torchs():
    image, mask = discs(8)
    recorded = []
    for seed in (1, 1, 2):
        torch.manual_seed(seed)
        recorded.append(PhotometricAugmentation()(image, mask))
    assert torch.equal(recorded[0], recorded[1])
    assert not torch.equal(recorded[0], recorded[2])


@pytest.mark.parametrize("name", ["exposure", "cast", "blur", "noise", "edge"])
def test_a_negative_number_is_an_error(name):
    with pytest.raises(ValueError, match=f"PhotometricAugmentation: {name}"):
        PhotometricAugmentation(**{name: -0.1})
