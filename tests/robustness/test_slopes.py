"""Slopes of what stands between photo and pose are those of finite differences, in double precision."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from torch import Tensor

from kfit.geometry import (
    Crop,
    box_corners,
    diagonal_at,
    energy_weights,
    pose_from_crop,
    project,
    rotation_error,
    rotation_from_angles,
    rotation_sigma_deg,
    viewing_ray,
    viewing_ray_rotation,
)

CAMERA = torch.tensor([[80.0, 0, 30.0], [0, 90.0, 20.0], [0, 0, 1]], dtype=torch.float64)
CROP = Crop((34.0, 22.0), 20.0, 8)
QUICK = settings(
    derandomize=True, database=None, deadline=None, max_examples=25, suppress_health_check=list(HealthCheck)
)
TURNS = st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi]) | st.floats(-7, 7)


def float64(*numbers: float) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


class TestSlopesAreThoseOfDifferences:
    @pytest.mark.slow
    @QUICK
    @given(TURNS, TURNS, TURNS)
    def test_of_rotations_at_any_angles(self, azimuth: float, elevation: float, roll: float) -> None:
        angles = [float64(angle).requires_grad_() for angle in (azimuth, elevation, roll)]
        assert torch.autograd.gradcheck(rotation_from_angles, angles)

    @pytest.mark.slow
    @QUICK
    @given(TURNS, TURNS, TURNS)
    def test_of_a_pose_read_off_a_crop_at_any_angles(self, azimuth: float, elevation: float, roll: float) -> None:
        values = [float64(azimuth), float64(elevation), float64(roll), float64(0.1, -0.3)[None], float64(1.2)]

        def pose(*values: Tensor) -> tuple[Tensor, Tensor]:
            return pose_from_crop(*values, CROP, CAMERA, 0.2)

        assert torch.autograd.gradcheck(pose, [value.requires_grad_() for value in values])

    @pytest.mark.parametrize(
        ("function", "inputs"),
        [
            (lambda pixel: viewing_ray(pixel, CAMERA), [float64(3.0, 9.0)]),
            (lambda pixel: viewing_ray_rotation(pixel, CAMERA), [float64(3.0, 9.0)]),
            (lambda pixel: viewing_ray_rotation(pixel, CAMERA), [float64(30.0, 20.0)]),  # on the axis
            (lambda d, s, k: diagonal_at(d, s, k, CROP, CAMERA), [float64(0.7), float64(0, 0.2)[None], float64(1.1)]),
            (lambda t, size: box_corners(torch.eye(3).double(), t, size), [float64(0, 0, 1), float64(1, 2, 3)]),
            (lambda points: project(points, CAMERA), [float64(0.1, 0.2, 1.0)[None]]),
            (energy_weights, [float64(1.0, 1.1, 3.0)]),
        ],
    )
    def test_of_cameras_and_boxes(self, function, inputs) -> None:
        assert torch.autograd.gradcheck(function, [value.clone().requires_grad_() for value in inputs])

    def test_of_a_crop_which_is_a_mean_of_pixels(self) -> None:
        photo, step, mask = 0.4 + 0.2 * torch.rand(40, 60, 3), 0.1 * torch.rand(40, 60, 3), torch.ones(40, 60)
        share = torch.rand(1, 3, 8, 8)
        (slope,) = torch.autograd.grad((CROP.cut(photo.requires_grad_(), mask).image * share).sum(), photo)
        difference = (CROP.cut(photo + step, mask).image - CROP.cut(photo, mask).image) * share
        torch.testing.assert_close((slope * step).sum(), difference.sum(), rtol=1e-4, atol=0)

    @pytest.mark.parametrize("symmetry", ["none", "y"])
    @pytest.mark.parametrize("apart", [0.0, 1e-9, 1.0, math.pi - 1e-9, math.pi])
    def test_of_an_angle_between_rotations_are_finite_even_at_none_and_half_a_turn(self, symmetry, apart) -> None:
        angle = float64(apart).requires_grad_()
        one, other = rotation_from_angles(float64(0.3), angle, float64(0.0)), rotation_from_angles(*float64(0.3, 0, 0))
        error = rotation_error(one, other, symmetry)
        (slope,) = torch.autograd.grad(error.sum(), angle)
        assert float(error.detach()) == pytest.approx(apart, abs=1e-7)
        # At neither end it has a slope, only bounds of it.
        assert abs(float(slope)) == pytest.approx(1.0, abs=1e-6) or (apart in (0.0, math.pi) and abs(float(slope)) <= 1)
        sigma = rotation_sigma_deg(one.detach(), float64(1.0), other, symmetry)
        assert float(sigma) == pytest.approx(math.degrees(apart), abs=1e-5)
