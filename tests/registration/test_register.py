"""Registration in one call."""

import pytest
import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points

import kfit
from kfit.energies import NCC
from kfit.generators import Template

TRUTH = {
    "translation": {"shift": [0.1, -0.06]},
    "euclidean": {"roll": 0.1, "shift": [0.08, -0.05]},
    "similarity": {"roll": 0.12, "shift": [0.05, 0.05], "scale": 1.08},
    "affine": {"roll": -0.08, "shift": [0.05, -0.05], "scale": 0.95, "stretch": 1.06, "shear": 0.08},
    "homography": {"corners": [[0.08, -0.06], [-0.02, -0.1], [-0.06, 0.05], [0.06, 0.1]]},
}


def picture(size=(72, 72), seed=0):
    coarse = torch.rand(1, 3, 9, 9, generator=torch.Generator().manual_seed(seed))
    return F.interpolate(coarse, size, mode="bicubic", align_corners=True)[0].clamp(0, 1)


def pair_of(motion, **light):
    """A picture and what a motion makes of it, with what lies outside filled by noise that must not count."""
    template = Template(picture(), motion, light=bool(light), oversampling=4)
    values = {k: torch.tensor([v]) for k, v in (TRUTH[motion] | light).items()}
    drawn = template(**values)
    noise = torch.rand(drawn.image.shape, generator=torch.Generator().manual_seed(1))
    fixed = torch.where(drawn.weight > 0.99, drawn.image, noise)
    return fixed, drawn.weight, template.matrix(**{k: v for k, v in values.items() if k in TRUTH[motion]})


def corner_error(found, truth, size=72):
    corners = torch.tensor([[[0.0, 0.0], [size - 1, 0.0], [size - 1, size - 1], [0.0, size - 1]]])
    return float((transform_points(found, corners) - transform_points(truth, corners)).norm(dim=2).mean())


BETWEEN = ("similarity", "affine")  # which a homography contains


@pytest.mark.parametrize(
    "motion", [pytest.param(name, marks=pytest.mark.slow) if name in BETWEEN else name for name in TRUTH]
)
def test_each_motion_is_found_to_a_fraction_of_a_pixel(motion):
    fixed, weight, truth = pair_of(motion)
    found = kfit.register(picture()[None], fixed, motion, fixed_mask=(weight > 0.99).float())
    assert corner_error(found.matrix, truth) < 0.1
    assert float(found.overlap) > 0.95
    assert len(found.fits) == 2


def test_gain_and_offset_are_found_too():
    fixed, weight, truth = pair_of("similarity", gain=0.7, bias=0.2)
    found = kfit.register(picture()[None], fixed, "similarity", fixed_mask=(weight > 0.99).float())
    assert corner_error(found.matrix, truth) < 0.1
    assert float(found.gain) == pytest.approx(0.7, abs=0.02)
    assert float(found.offset) == pytest.approx(0.2, abs=0.02)


@pytest.mark.slow
def test_a_batch_of_pairs_is_as_its_pairs_alone():
    fixed, weight, _ = pair_of("euclidean")
    moving = torch.stack([picture(), picture(seed=3)])
    fixed = torch.cat([fixed, picture(seed=3).roll(4, -1)[None]])
    mask = torch.cat([(weight > 0.99).float(), torch.ones(1, 1, 72, 72)])
    mask[1, ..., :4] = 0
    together = kfit.register(moving, fixed, "euclidean", fixed_mask=mask)
    for row in range(2):
        rows = slice(row, row + 1)
        alone = kfit.register(moving[rows], fixed[rows], "euclidean", fixed_mask=mask[rows])
        torch.testing.assert_close(together.matrix[rows], alone.matrix, rtol=0, atol=2e-3)
    torch.testing.assert_close(together.matrix[1, :2, 2], torch.tensor([4.0, 0.0]), rtol=0, atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["tps", "flow"])
def test_a_bent_picture_is_straightened(motion):
    template = Template(picture(), motion, control=(4, 4), oversampling=4)
    bend = 0.06 * torch.randn(1, 2, 4, 4, generator=torch.Generator().manual_seed(2))
    drawn = template(displacement=bend)
    found = kfit.register(
        picture()[None], drawn.image, motion, fixed_mask=drawn.weight, control=(4, 4), smoothness=1e-4
    )
    truth = template.places(displacement=bend)
    inside = drawn.weight[0, 0] > 0.99
    apart = found.displacement.movedim(1, -1) - (truth - Template(picture()).places(corners=torch.zeros(1, 4, 2)))
    assert found.matrix is None
    assert float(apart.norm(dim=-1)[0][inside].median()) < 0.15


@pytest.mark.slow
def test_other_energies_serve_pictures_of_other_light():
    fixed, weight, truth = pair_of("similarity")
    found = kfit.register(
        picture()[None], 1 - fixed.square(), "similarity", energy=_Negated(), fixed_mask=(weight > 0.99).float()
    )
    assert corner_error(found.matrix, truth) < 0.5


class _Negated(NCC):
    """Correlation of a picture with another's negative."""

    def compare(self, prediction, prepared):
        return super().compare(1 - prediction, prepared)


def test_points_and_other_pictures_go_the_same_way():
    fixed, weight, truth = pair_of("translation")
    found = kfit.register(picture()[None], fixed, "translation", fixed_mask=(weight > 0.99).float(), light=False)
    points = torch.tensor([[[30.0, 40.0], [10.0, 50.0]]])
    torch.testing.assert_close(
        found.transform_points(points), transform_points(truth.inverse(), points), rtol=0, atol=0.1
    )
    inside = found.weight.expand(-1, 3, -1, -1) > 0.999
    assert float((found.warp(picture()[None]) - found.warped)[inside].abs().max()) < 0.02


def test_pictures_of_other_sizes_are_registered_in_pixels():
    moving = picture((72, 72))
    fixed = moving[None, :, 6:62, 4:68]
    found = kfit.register(moving, fixed, "translation")
    assert found.warped.shape[-2:] == (72, 72)
    torch.testing.assert_close(found.matrix[0, :2, 2], torch.tensor([-4.0, -6.0]), rtol=0, atol=0.05)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"motion": "rigid"}, ValueError, "motion must be one of translation"),
        ({"energy": torch.nn.L1Loss()}, TypeError, "energy must be a kfit.core.Energy, got L1Loss"),
        ({"fixed_mask": torch.ones(1, 1, 5, 5)}, ValueError, r"fixed_mask must have shape \(1, 1, 24, 24\)"),
        ({"initial": torch.eye(3)}, ValueError, r"initial must have shape \(1, 3, 3\)"),
        ({"fixed": torch.rand(1, 1, 24, 24)}, ValueError, "must agree in number and channels"),
        ({"fixed": torch.zeros(1, 3, 24, 24, dtype=torch.uint8)}, TypeError, "fixed must be a floating-point"),
        ({"fixed": torch.zeros(1, 3, 4, 4)}, ValueError, "at least 8 × 8"),
    ],
)
def test_what_cannot_be_registered_is_refused_in_a_sentence(arguments, error, message):
    with pytest.raises(error, match=message):
        kfit.register(**{"moving": torch.rand(1, 3, 24, 24), "fixed": torch.rand(1, 3, 24, 24)} | arguments)
