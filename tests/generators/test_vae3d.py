"""The paper's generator: its sizes, the sense in which its volume turns, and its normalisation."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch.nn import functional as F
from torch.utils.flop_counter import FlopCounterMode

from kfit.core import frozen
from kfit.data.light import Light
from kfit.data.rasterizer import pose_view
from kfit.data.shapes.primitives import revolve
from kfit.data.shapes.textures import solid
from kfit.generators import VAE3D
from kfit.generators.adain import AdaIN
from kfit.generators.vae3d import turn_volume
from kfit.geometry.pose import rotation_from_angles


def multiply_adds(generator):
    with FlopCounterMode(display=False) as counter:
        frozen(generator)(code=torch.zeros(1, 16), azimuth=torch.zeros(1), elevation=torch.zeros(1))
    return counter.get_total_flops() / 2


def parameters(generator):
    return sum(p.numel() for p in generator.parameters())


def by_formula(code, volume, projection, decoder):
    """Parameters and convolutions' multiply-adds: a transposed 4×4(×4) convolution of stride 2 has 4^d · C_in · C_out
    weights, each used once an input place."""
    numbers, work, side = volume[0] * 4**3, 0, 4
    for a, b in pairwise(volume):
        numbers += 64 * a * b + b
        work += 64 * a * b * side**3
        side *= 2
    numbers += volume[-1] * side * projection + projection
    work += volume[-1] * side * projection * side**2
    for a, b in pairwise((projection, *decoder)):
        numbers += 16 * a * b + b
        work += 16 * a * b * side**2
        side *= 2
    numbers += 9 * decoder[-1] * 4 + 4
    work += 9 * decoder[-1] * 4 * side**2
    numbers += sum((code + 1) * 2 * dim for dim in (*volume, *decoder))
    return numbers, work


class TestSizes:
    def test_compact_has_two_million_parameters_and_half_a_billion_multiply_adds(self):
        numbers, work = by_formula(16, (256, 64, 32), 256, (128, 64))
        assert parameters(VAE3D()) == numbers == 2_003_812
        assert multiply_adds(VAE3D()) == pytest.approx(work, rel=1e-3)
        assert work == pytest.approx(0.45e9, rel=0.01)

    def test_the_paper_s_are_the_released_code_s(self):
        generator = VAE3D.paper()
        numbers, work = by_formula(16, (512, 128, 64), 1024, (256, 64))
        assert generator.constant.shape == (1, 512, 4, 4, 4)
        assert [(up.in_channels, up.out_channels) for up in generator.lift] == [(512, 128), (128, 64)]
        assert (generator.project.in_channels, generator.project.out_channels) == (64 * 16, 1024)
        assert [(up.in_channels, up.out_channels) for up in generator.decode] == [(1024, 256), (256, 64)]
        assert parameters(generator) == numbers == 10_295_044
        assert multiply_adds(generator) == pytest.approx(work, rel=1e-3)

    def test_compact_does_a_fifth_of_the_work(self):
        assert multiply_adds(VAE3D()) / multiply_adds(VAE3D.paper()) == pytest.approx(0.2, abs=0.01)

    @pytest.mark.parametrize(("decoder", "side"), [((8,), 32), ((8, 8), 64), ((8, 8, 8), 128)])
    def test_the_picture_s_side_doubles_with_each_layer(self, decoder, side):
        generator = VAE3D(4, (8, 4, 4), 8, decoder)
        drawn = generator(code=torch.zeros(2, 4), azimuth=torch.zeros(2), elevation=torch.zeros(2))
        assert drawn.image.shape == (2, 3, side, side)
        assert drawn.mask.shape == (2, 1, side, side)
        assert generator.image_size == side


SIZE, CENTRE = 17, 8.0


def blob(x, y, z):
    """A volume with a soft ball at a point of the y-up frame (z towards the viewer), in voxels from the centre."""
    depth, down, right = torch.meshgrid(*[torch.arange(SIZE, dtype=torch.float64) - CENTRE] * 3, indexing="ij")
    away = (right - x).square() + (-down - y).square() + (-depth - z).square()
    return torch.exp(-away / 2)[None, None]


def place(volume):
    """Where the ball is in the y-up frame."""
    grid = torch.meshgrid(*[torch.arange(SIZE, dtype=torch.float64) - CENTRE] * 3, indexing="ij")
    share = volume[0, 0] / volume.sum()
    depth, down, right = (float((share * axis).sum()) for axis in grid)
    return right, -down, -depth


def rotated(at, azimuth_deg=0.0, elevation_deg=0.0):
    angles = (torch.tensor([math.radians(a)], dtype=torch.float64) for a in (azimuth_deg, elevation_deg, 0.0))
    return place(turn_volume(blob(*at), rotation_from_angles(*angles)))


class TestTurning:
    def test_positive_azimuth_moves_what_is_near_the_viewer_to_the_right(self):
        x, y, z = rotated((0, 0, 4), azimuth_deg=30)
        assert (x, y, z) == pytest.approx((2, 0, 2 * math.sqrt(3)), abs=0.05)

    def test_positive_azimuth_moves_what_is_far_from_the_viewer_to_the_left(self):
        assert rotated((0, 0, -4), azimuth_deg=90) == pytest.approx((-4, 0, 0), abs=0.05)

    def test_positive_elevation_tips_the_top_towards_the_viewer(self):
        assert rotated((0, 4, 0), elevation_deg=30) == pytest.approx((0, 2 * math.sqrt(3), 2), abs=0.05)

    def test_turns_first_by_azimuth_about_the_object_s_axis_then_by_elevation(self):
        assert rotated((0, 0, 4), azimuth_deg=90, elevation_deg=90) == pytest.approx((4, 0, 0), abs=0.05)
        assert rotated((4, 0, 0), azimuth_deg=90, elevation_deg=90) == pytest.approx((0, 4, 0), abs=0.05)

    @pytest.mark.parametrize(("azimuth", "elevation"), [(40, 0), (0, 35), (-75, 50), (160, -15)])
    def test_moves_points_as_the_rotation_matrix_does(self, azimuth, elevation):
        at = (2.0, -1.0, 3.0)
        rotation = rotation_from_angles(*torch.tensor([azimuth, elevation, 0.0], dtype=torch.float64).deg2rad())
        expected = rotation @ torch.tensor(at, dtype=torch.float64)
        assert rotated(at, azimuth, elevation) == pytest.approx(expected.tolist(), abs=0.05)

    @pytest.mark.parametrize(("azimuth", "elevation"), [(40, 0), (0, 35), (-60, 50), (130, -15)])
    def test_turns_in_the_sense_in_which_meshes_are_drawn(self, azimuth, elevation):
        # A ball of a tenth of a diagonal beside the centre, seen by the rasterizer's camera.
        at = np.array([0.1, 0.05, 0.25])
        ring = np.linspace(-np.pi / 2, np.pi / 2, 24)
        ball = revolve(0.1 * np.stack([np.cos(ring), np.sin(ring)], 1), solid(np.full(3, 0.5)), 24)
        ball = replace(ball, vertices=ball.vertices + at.astype(np.float32))
        view = pose_view(
            ball, math.radians(elevation), math.radians(azimuth), Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
        )
        rows, columns = np.nonzero(view.mask > 0.5 * view.mask.max())
        drawn = np.array([columns.mean() - 31.5, 31.5 - rows.mean()]) / (0.95 * 64)
        x, y, _ = rotated(20 * at, azimuth, elevation)
        # The camera is 4 diagonals away: perspective moves the ball by less than a tenth of its way.
        np.testing.assert_allclose(drawn, np.array([x, y]) / 20, atol=0.03)

    def test_by_nothing_changes_nothing(self):
        volume = torch.rand(2, 3, 5, 5, 5)
        still = turn_volume(volume, torch.eye(3).expand(2, 3, 3))
        torch.testing.assert_close(still, volume, rtol=0, atol=1e-5)

    def test_by_a_quarter_moves_voxels_exactly(self):
        volume = torch.rand(1, 2, 6, 6, 6, dtype=torch.float64)
        quarter = rotation_from_angles(*torch.tensor([[math.pi / 2], [0.0], [0.0]], dtype=torch.float64))
        # x ← z: the new right is what was near, so (D, H, W) takes W from the reversed D.
        expected = volume.transpose(2, 4).flip(4)
        torch.testing.assert_close(turn_volume(volume, quarter), expected, rtol=0, atol=1e-9)

    def test_space_outside_repeats_the_border(self):
        angles = torch.tensor([[0.6], [0.4], [0.0]], dtype=torch.float64)
        filled = turn_volume(torch.ones(1, 1, 6, 6, 6, dtype=torch.float64), rotation_from_angles(*angles))
        torch.testing.assert_close(filled, torch.ones_like(filled))

    def test_is_a_volume_in_full_precision_whatever_came(self):
        volume = torch.rand(1, 1, 4, 4, 4)
        assert turn_volume(volume.bfloat16(), torch.eye(3)[None]).dtype == torch.float32
        assert turn_volume(volume, torch.eye(3, dtype=torch.float64)[None]).dtype == torch.float64


def test_the_code_changes_the_picture_and_the_angles_turn_it_full_circle():
    torch.manual_seed(0)
    generator = VAE3D(4, (8, 4, 4), 8, (8,)).double()
    code = torch.randn(1, 4, dtype=torch.float64)
    zero, angle = torch.zeros(1, dtype=torch.float64), torch.full((1,), 0.7, dtype=torch.float64)
    first = generator(code=code, azimuth=angle, elevation=zero).image
    torch.testing.assert_close(generator(code=code, azimuth=angle + 2 * math.pi, elevation=zero).image, first)
    assert not torch.allclose(generator(code=code, azimuth=zero, elevation=zero).image, first)
    assert not torch.allclose(generator(code=code, azimuth=angle, elevation=angle).image, first)
    assert not torch.allclose(generator(code=-code, azimuth=angle, elevation=zero).image, first)


class TestAdaIN:
    def test_is_the_formula_computed_by_hand(self):
        layer = AdaIN(1, 2, rectified=True).double()
        with torch.no_grad():
            layer.affine.weight.copy_(torch.tensor([[1.0, 0.0], [0.0, 2.0]]))
            layer.affine.bias.copy_(torch.tensor([0.5, -1.0]))
        style = layer.style(torch.tensor([[1.0, 2.0], [-3.0, 0.25]], dtype=torch.float64))
        # relu(1 · 1 + 0.5) = 1.5 and relu(2 · 2 − 1) = 3; both are closed for the second code.
        assert style.tolist() == [[1.5, 3.0], [0.0, 0.0]]
        layer.rectified = False
        assert layer.style(torch.tensor([[-3.0, 0.25]], dtype=torch.float64)).tolist() == [[-2.5, -0.5]]
        features = torch.tensor([[[[0.0, 2.0], [4.0, 6.0]]], [[[1.0, 1.0], [2.0, 8.0]]]], dtype=torch.float64)
        # Mean 3, variance 5: (x − 3) / √5.00001 · 3 + 1.5.
        expected = torch.tensor([[-2.52491821, 0.15836060], [2.84163940, 5.52491821]], dtype=torch.float64)
        found = layer(features, style)
        torch.testing.assert_close(found[0, 0], expected, rtol=0, atol=1e-6)
        torch.testing.assert_close(found[1], torch.zeros(1, 2, 2, dtype=torch.float64))

    def test_leaves_each_channel_of_a_volume_with_the_mean_and_spread_asked_for(self):
        torch.manual_seed(0)
        layer = AdaIN(3, 4).double()
        style = layer.style(0.1 * torch.randn(2, 4, dtype=torch.float64))
        found = layer(7 + 5 * torch.rand(2, 3, 4, 4, 4, dtype=torch.float64), style)
        torch.testing.assert_close(found.mean((2, 3, 4)), style[:, :3])
        torch.testing.assert_close(found.flatten(2).std(2, correction=0), style[:, 3:], rtol=1e-4, atol=0)

    def test_starts_near_the_identity_of_normalised_features_with_every_unit_open(self):
        torch.manual_seed(0)
        layer, features = AdaIN(3, 4), torch.randn(2, 3, 8, 8)
        style = layer.style(torch.zeros(2, 4))
        torch.testing.assert_close(style, torch.tensor([[0.1] * 3 + [1.0] * 3] * 2))
        torch.testing.assert_close(layer(features, style), F.instance_norm(features) + 0.1)
