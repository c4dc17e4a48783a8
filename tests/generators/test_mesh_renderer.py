"""The soft drawing of a known mesh, held against the exact rasterizer."""

import math

import numpy as np
import pytest
import torch

from kfit.data import Light, build, pose_view
from kfit.generators import MeshRenderer, SimilarityWarp

POSES = [(0.5, 0.4), (2.0, 1.0), (-1.2, 0.1)]


@pytest.fixture(scope="module")
def mug():
    return build("mug", 7)[0]


@pytest.fixture(scope="module")
def drawer(mug):
    return MeshRenderer(mug.vertices, mug.faces, mug.uv, mug.texture)


def values(azimuth=0.0, elevation=0.0, roll=0.0, shift=(0.0, 0.0), scale=1.0):
    numbers = {"azimuth": azimuth, "elevation": elevation, "roll": roll, "shift": shift, "scale": scale}
    return {name: torch.tensor([number]) for name, number in numbers.items()}


def exact(mesh, azimuth, elevation):
    """The rasterizer's view with no light but an even one; depth behind the object's centre."""
    even = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
    view = pose_view(mesh, elevation, azimuth, even, supersample=4)
    return (torch.from_numpy(part) for part in (view.image, view.mask, view.depth - 4))


@pytest.mark.parametrize(("azimuth", "elevation"), POSES)
def test_mask_and_depth_are_those_of_an_exact_rasterizer(mug, drawer, azimuth, elevation):
    _, mask, depth = exact(mug, azimuth, elevation)
    drawn = drawer(**values(azimuth, elevation))
    overlap = torch.minimum(drawn.mask[0, 0], mask).sum() / torch.maximum(drawn.mask[0, 0], mask).sum()
    assert float(overlap) > 0.96
    assert float(drawn.mask.sum() / mask.sum()) == pytest.approx(1, abs=0.02)
    inside = mask == 1
    away = (drawn.depth[0, 0] - depth)[inside]
    assert float(away.median().abs()) < 0.01  # box diagonals
    assert float(away.abs().mean()) < 0.05


def test_every_category_s_silhouette_is_close():
    for category in ("laptop", "can", "bowl", "bottle", "camera"):
        mesh, _ = build(category, 3)
        _, mask, _ = exact(mesh, 0.6, 0.5)
        drawn = MeshRenderer(mesh.vertices, mesh.faces, mesh.uv, mesh.texture)(**values(0.6, 0.5)).mask[0, 0]
        assert float(torch.minimum(drawn, mask).sum() / torch.maximum(drawn, mask).sum()) > 0.94, category


def squares(*colors_and_depths):
    """Squares of side 0.5 that face the viewer, as thin closed boxes would look: two layers each."""
    corners = torch.tensor([[-0.25, -0.25], [0.25, -0.25], [0.25, 0.25], [-0.25, 0.25]])
    vertices, faces, uv, texture = [], [], [], []
    for number, (color, z) in enumerate(colors_and_depths):
        for layer in (z, z - 0.01):
            first = 4 * len(vertices)
            vertices.append(torch.cat([corners, torch.full((4, 1), layer)], 1))
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
            uv += 4 * [[(number + 0.5) / len(colors_and_depths), 0.5]]
        texture.append(color)
    return torch.cat(vertices), torch.tensor(faces), torch.tensor(uv), torch.tensor([texture])


def test_the_nearest_surface_gives_colour_and_depth_and_the_ground_is_white():
    red, blue = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    for near, far in ((red, blue), (blue, red)):
        drawn = MeshRenderer(*squares((near, 0.2), (far, -0.2)))(**values())
        torch.testing.assert_close(drawn.image[0, :, 32, 32], torch.tensor(near), rtol=0, atol=0.01)
        assert float(drawn.depth[0, 0, 32, 32]) == pytest.approx(-0.2, abs=0.01)
        torch.testing.assert_close(drawn.image[0, :, 2, 2], torch.ones(3))
        assert float(drawn.mask[0, 0, 2, 2]) == 0


def test_an_edge_lies_where_the_mask_is_a_half():
    drawn = MeshRenderer(*squares(([0.5, 0.5, 0.5], 0.0)), num_points=40_000, unit_fraction=4 / 15.75**0.5)
    # From 4 diagonals one diagonal at the centre spans the picture. Sides of 0.5 diagonals are 32 pixels, from 15.5 to
    # 47.5: an edge through the centres of no pixel.
    row = drawn(**values(shift=(1 / 64, 0.0))).mask[0, 0, 32]
    assert float(row[16]) == pytest.approx(0.5, abs=0.05)
    assert float(row[48]) == pytest.approx(0.5, abs=0.05)
    assert float(row[18:46].min()) > 0.9
    assert float(row[:14].max()) < 0.01


def test_roll_shift_and_scale_are_those_of_a_similarity_warp(drawer):
    plain = drawer.bind(roll=torch.tensor(0.0), shift=torch.zeros(2), scale=torch.tensor(1.0))
    inputs = values(0.5, 0.4, roll=0.4, shift=(0.15, -0.1), scale=0.8)
    own, warped = drawer(**inputs), SimilarityWarp(plain)(**inputs)
    assert float((own.mask - warped.mask).abs().mean()) < 0.01
    assert float((own.image - warped.image).abs().mean()) < 0.005
    both = (own.mask > 0.99) & (warped.mask > 0.99)
    assert float((own.depth - warped.depth)[both].abs().median()) < 0.01


def test_what_leaves_the_picture_is_gone_and_nan_stays_in_its_row(drawer):
    inputs = {name: value.repeat(3, *[1] * (value.dim() - 1)) for name, value in values(0.5, 0.4).items()}
    inputs["shift"] = torch.tensor([[0.0, 0.0], [9.0, -9.0], [math.nan, math.inf]], requires_grad=True)
    drawn = drawer(**inputs)
    assert bool((drawn.image[1] == 1).all())
    torch.testing.assert_close(drawn.mask[0], drawer(**values(0.5, 0.4)).mask[0])
    drawn.mask[:2].sum().backward()
    assert bool(inputs["shift"].grad[:2].isfinite().all())


@pytest.mark.parametrize(
    ("name", "away"), [("elevation", 0.1), ("roll", 0.1), ("scale", 0.1), ("shift", 0.06), ("shift", -0.06)]
)
def test_the_gradient_of_the_overlap_points_back_to_the_pose(drawer, name, away):
    inputs = values(0.5, 0.4)
    target = drawer(**inputs).mask
    moved = inputs | {name: (inputs[name] + away).requires_grad_()}
    (drawer(**moved).mask - target).square().sum().backward()
    assert bool((moved[name].grad * away > 0).all())


def test_autocast_leaves_the_drawing_as_it_is(drawer):
    expected = drawer(**values(0.5, 0.4))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = drawer(**values(0.5, 0.4))
    torch.testing.assert_close(found.image, expected.image)


def test_wrong_meshes_are_refused_by_name():
    vertices, faces, uv, texture = squares(([0.0, 0.0, 0.0], 0.0))
    with pytest.raises(ValueError, match=r"MeshRenderer: uv must have shape \(8, 2\), got \(3, 2\)"):
        MeshRenderer(vertices, faces, uv[:3], texture)
    with pytest.raises(ValueError, match=r"MeshRenderer: faces must have shape \(F, 3\)"):
        MeshRenderer(vertices, faces[:, :2], uv, texture)
    with pytest.raises(ValueError, match="must span an area"):
        MeshRenderer(0 * vertices, faces, uv, texture)
    with pytest.raises(ValueError, match="distance must lie between"):
        MeshRenderer(vertices, faces, uv, texture, distance=0.2)
