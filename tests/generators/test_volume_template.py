"""The generator that moves a volume of its own."""

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from kfit.core import Observation
from kfit.generators import VolumeTemplate
from kfit.generators.volume_motions import volume_values_of

MOTIONS = ["translation", "euclidean", "similarity", "affine"]


def values_near_none(motion, rows=2, dtype=torch.float64):
    rng = torch.Generator().manual_seed(4)
    turns = axis_angle_to_rotation_matrix(0.3 * torch.randn(rows, 3, generator=rng, dtype=dtype))
    scale = 1 + 0.2 * torch.rand(rows, generator=rng, dtype=dtype)
    every = {
        "shift": 0.2 * torch.randn(rows, 3, generator=rng, dtype=dtype),
        "rotation": turns,
        "scale": scale,
        "linear": turns * scale[:, None, None] + 0.05,
    }
    return {name: every[name] for name in template(motion).moving}


def template(motion, rows=1, light=False):
    pixels = torch.rand(rows, 2, 6, 7, 8, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return VolumeTemplate(pixels, motion, light=light)


@pytest.mark.parametrize("motion", MOTIONS)
def test_values_come_back_from_their_matrix(motion):
    values = values_near_none(motion)
    back = volume_values_of(motion, template(motion).matrix(**values), (6, 7, 8))
    assert set(back) == set(values)
    for name, value in values.items():
        torch.testing.assert_close(back[name], value)


@pytest.mark.parametrize("motion", MOTIONS)
def test_gradients_of_volumes_are_those_of_finite_differences(motion):
    drawer, values = template(motion), values_near_none(motion, 1)

    def draw(*args):
        rendering = drawer(**dict(zip(values, args, strict=True)))
        return rendering.image, rendering.mask

    assert torch.autograd.gradcheck(draw, [value.requires_grad_() for value in values.values()], fast_mode=True)


def test_no_motion_leaves_a_volume_as_it_is():
    drawer = template("affine", light=True)
    still = {"shift": torch.zeros(1, 3), "linear": torch.eye(3)[None], "gain": torch.ones(1), "bias": torch.zeros(1)}
    drawn = drawer(**{name: value.double() for name, value in still.items()})
    torch.testing.assert_close(drawn.image, drawer.voxels[:, :2])
    torch.testing.assert_close(drawn.weight, torch.ones(1, 1, 6, 7, 8).double())


def test_what_moves_is_where_its_places_read():
    drawer = template("translation")
    shift = torch.tensor([[2 / 8 * 2, 0.0, -1 / 6 * 2]]).double()  # 2 voxels along x and −1 along z
    drawn = drawer(shift=shift)
    torch.testing.assert_close(drawn.image[:, :, :-1, :, 2:], drawer.voxels[:, :2, 1:, :, :-2])
    assert float(drawn.weight[..., :2].max()) == 0
    torch.testing.assert_close(drawer.places(shift=shift)[0, 0, 0, 0], torch.tensor([-2.0, 0.0, 1.0]).double())


@pytest.mark.parametrize("broken", [0.0, float("nan"), float("inf"), 1e30, -1.0])
def test_a_motion_without_inverse_covers_nothing_and_spoils_no_row(broken):
    drawer = template("affine")
    values = values_near_none("affine", 3)
    spoilt = {**values, "linear": values["linear"].clone()}
    spoilt["linear"][1] = broken * torch.eye(3)
    expected, found = drawer(**values), drawer(**spoilt)
    torch.testing.assert_close(found.image[[0, 2]], expected.image[[0, 2]])
    assert float(found.weight[1].max()) == 0


def test_each_problem_is_fitted_to_its_own_volume():
    drawer = template("translation", rows=2)
    shift = torch.zeros(2, 3).double()
    drawn = drawer(shift=shift, template=torch.tensor([1, 0]))
    torch.testing.assert_close(drawn.image, drawer.voxels[[1, 0], :2])
    with pytest.raises(ValueError, match="2 volumes cannot be fitted to 3 problems"):
        drawer.prepare(Observation(torch.rand(3, 2, 6, 7, 8)))


def test_a_picture_is_no_volume():
    with pytest.raises(ValueError, match=r"volume must have shape \(B, C, D, H, W\)"):
        VolumeTemplate(torch.rand(1, 3, 8, 8))
