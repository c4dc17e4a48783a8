"""Updates of rotations in the camera's axes, and what a refiner sees."""

import math

import pytest
import torch

from kfit.geometry import refiner_input, rotation_from_angles, rotation_update, updated_rotation


def rotations(count=6, seed=0):
    angles = 3 * torch.rand(3, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return rotation_from_angles(*angles)


def test_an_update_leads_to_its_target():
    here, there = rotations(), rotations(seed=1)
    torch.testing.assert_close(updated_rotation(here, rotation_update(here, there)), there)


def test_a_symmetric_object_is_turned_by_the_least_angle_that_moves_its_axis():
    here, there = rotations(), rotations(seed=1)
    update = rotation_update(here, there, "y")
    torch.testing.assert_close(updated_rotation(here, update)[:, :, 1], there[:, :, 1])
    torch.testing.assert_close((update * here[:, :, 1]).sum(1), torch.zeros(6).double())


def test_a_turn_of_the_picture_is_a_turn_about_the_viewing_axis():
    here = rotations()
    rotated = rotation_from_angles(*torch.tensor([[0.0], [0.0], [0.2]]).double()) @ here
    expected = torch.tensor([[0.0, 0.0, 0.2]]).double().expand(6, 3)
    torch.testing.assert_close(rotation_update(here, rotated), expected)


@pytest.mark.parametrize("symmetry", ["none", "y"])
def test_no_update_is_needed_at_the_target(symmetry):
    here = rotations()
    torch.testing.assert_close(rotation_update(here, here, symmetry), torch.zeros(6, 3).double())


def test_straight_from_above_an_update_is_as_small_as_the_motion():
    above = rotation_from_angles(*torch.tensor([[0.3], [math.pi / 2], [0.0]]).double())
    moved = updated_rotation(above, torch.tensor([[0.0, 0.01, 0.0]]).double())
    assert float(rotation_update(above, moved).norm()) == pytest.approx(0.01)


def test_pixels_of_weight_0_are_white_and_no_object():
    image, mask = torch.rand(1, 3, 4, 4), torch.ones(1, 1, 4, 4)
    weight = torch.ones(1, 1, 4, 4)
    weight[..., 1, 2] = 0
    image[..., 1, 2] = torch.nan
    observed = refiner_input(image, mask, weight)
    assert observed[0, :, 1, 2].tolist() == [1, 1, 1, 0]
    assert torch.equal(observed[..., 0], torch.cat([image, mask], 1)[..., 0])
