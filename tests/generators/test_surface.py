"""The surface of a volume, held against a ball's."""

import math

import numpy as np
import pytest
import torch
import trimesh

from kfit.generators import RadianceField
from kfit.generators.surface import surface_of


def ball(radius=0.3, side=32, half_sides=(0.4, 0.45, 0.5)):
    """Raw colour and density of a ball whose upper half is red, in diagonals."""
    half = torch.tensor(half_sides)
    axes = [(2 * (torch.arange(side) + 0.5) / side - 1) * h for h in half]
    z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    density = 40 * (radius - (x**2 + y**2 + z**2).sqrt()) + 6.65
    red = torch.where(y > 0, 8.0, -8.0)
    return torch.stack([red, -8 + 0 * y, -8 + 0 * y, density.clamp_min(0)]), half


def test_a_ball_s_surface_is_closed_and_in_its_place():
    volume, half = ball()
    surface = surface_of(volume, half, thickness=16.0)
    radius = np.linalg.norm(surface.vertices, axis=1)
    assert np.abs(radius - 0.3).max() < 0.01
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * math.pi * 0.3**3, rel=0.03)  # above 0: faces look outwards
    top = surface.vertices[:, 1] > 0.05
    bottom = surface.vertices[:, 1] < -0.05
    assert surface.colors[top, 0].min() > 0.95
    assert surface.colors[bottom, 0].max() < 0.05
    assert surface.colors[:, 1:].max() < 0.01


def test_what_is_cut_by_the_box_is_closed_there():
    volume, half = ball(radius=0.6)
    mesh = trimesh.Trimesh(*surface_of(volume, half, 16.0)[:2], process=False)
    assert mesh.is_watertight
    assert np.abs(mesh.vertices).max(0) == pytest.approx(half.numpy(), abs=0.03)


def test_an_empty_volume_has_no_surface():
    with pytest.raises(ValueError, match="no surface"):
        surface_of(torch.zeros(4, 8, 8, 8), torch.full((3,), 0.5), 16.0)


def test_a_code_of_another_size_is_refused():
    field = RadianceField(code_dim=3, volume_dims=(4, 3), num_samples=4, image_size=16)
    with pytest.raises(ValueError, match=r"code must have shape \(3,\)"):
        field.surface(torch.zeros(4))
