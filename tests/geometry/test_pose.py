import math

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from kfit.geometry import angles_from_rotation, from_opencv, rotation_error, rotation_from_angles, to_opencv


def angles(*values: float) -> tuple[torch.Tensor, ...]:
    return tuple(torch.tensor(value, dtype=torch.float64) for value in values)


def test_the_rotation_equals_scipys_literal() -> None:
    # scipy 1.17: Rotation.from_euler("ZXY", [0.2, 0.5, -1.1]).as_matrix()
    expected = [
        [0.5294393604, -0.1743487403, -0.8302388093],
        [-0.3286350259, 0.8600893382, -0.3901863017],
        [0.7821080382, 0.4794255386, 0.3980680463],
    ]
    rotation = rotation_from_angles(*angles(-1.1, 0.5, 0.2))
    torch.testing.assert_close(rotation, torch.tensor(expected, dtype=torch.float64))


def test_azimuth_turns_the_front_to_the_right() -> None:
    front = rotation_from_angles(*angles(math.pi / 2, 0, 0))[:, 2]
    torch.testing.assert_close(front, torch.tensor([1.0, 0, 0], dtype=torch.float64))


def test_elevation_tips_the_top_towards_the_viewer() -> None:
    top = rotation_from_angles(*angles(0, math.pi / 2, 0))[:, 1]
    torch.testing.assert_close(top, torch.tensor([0, 0, 1.0], dtype=torch.float64))


def test_roll_turns_the_right_side_upwards() -> None:
    right = rotation_from_angles(*angles(0, 0, math.pi / 2))[:, 0]
    torch.testing.assert_close(right, torch.tensor([0, 1.0, 0], dtype=torch.float64))


def test_angles_come_back_from_the_rotation() -> None:
    azimuth = torch.linspace(-3.1, 3.1, 41)[:, None, None]
    elevation = torch.linspace(-1.5, 1.5, 11)[:, None]
    roll = torch.linspace(-3.1, 3.1, 13)
    found = angles_from_rotation(rotation_from_angles(azimuth, elevation, roll))
    for value, inputs in zip(found, (azimuth, elevation, roll), strict=True):
        torch.testing.assert_close(value, inputs.expand(41, 11, 13), atol=1e-5, rtol=0)


@pytest.mark.parametrize("off", [0.0, 1e-7, 1e-4])
@pytest.mark.parametrize("pole", [math.pi / 2, -math.pi / 2])
def test_straight_from_above_the_angles_still_make_the_same_rotation(pole: float, off: float) -> None:
    rotation = rotation_from_angles(torch.tensor(0.3), torch.tensor(pole - off), torch.tensor(0.2))
    again = rotation_from_angles(*angles_from_rotation(rotation))
    torch.testing.assert_close(again, rotation, atol=1e-6, rtol=0)


def test_the_rotation_is_smooth_at_zero() -> None:
    zero = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: rotation_from_angles(*v), (zero,))


def test_opencvs_axes_flip_y_and_z_and_stay_a_rotation() -> None:
    rotation = rotation_from_angles(*angles(0.4, 0.3, 0.1))
    flipped = to_opencv(rotation)
    torch.testing.assert_close(flipped[:, 1], rotation[:, 1] * torch.tensor([1.0, -1, -1]))
    torch.testing.assert_close(torch.linalg.det(flipped), torch.tensor(1.0, dtype=torch.float64))
    torch.testing.assert_close(from_opencv(flipped), rotation)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.7, math.pi - 1e-3, math.pi])
def test_the_error_keeps_its_digits_near_zero_and_half_a_turn(angle: float) -> None:
    a = rotation_from_angles(torch.tensor(0.3), torch.tensor(0.1), torch.tensor(0.2))
    axis = torch.tensor([2 / 3, -1 / 3, 2 / 3])
    b = a @ axis_angle_to_rotation_matrix(axis * angle)
    assert abs(float(rotation_error(a, b)) - angle) < 1e-6


def test_turning_about_the_vertical_axis_is_no_error_under_y_symmetry() -> None:
    a = rotation_from_angles(*angles(0.3, 0.4, 0.1))
    assert float(rotation_error(a, rotation_from_angles(*angles(2.9, 0.4, 0.1)), "y")) < 1e-12
    tilted = rotation_from_angles(*angles(2.9, 0.9, 0.1))
    assert float(rotation_error(a, tilted, "y")) == pytest.approx(0.5)
    assert float(rotation_error(a, tilted)) > 2


def test_errors_broadcast_over_rows() -> None:
    a = rotation_from_angles(torch.rand(5), torch.rand(5), torch.rand(5))
    assert rotation_error(a, a[0]).shape == (5,)


def test_an_unknown_symmetry_is_named() -> None:
    with pytest.raises(ValueError, match="symmetry must be one of none, y, y2"):
        rotation_error(torch.eye(3), torch.eye(3), "z")  # type: ignore[arg-type]
