"""Meshes: their box, their parts' atlas, and what a vertex sees."""

import numpy as np
import pytest

from kfit.data.exposure import with_exposure
from kfit.data.light import Light
from kfit.data.mesh import Mesh, join
from kfit.data.rasterizer import pose_view
from kfit.data.shapes.placing import shift, turn_x, turn_y
from kfit.data.shapes.primitives import plate, revolve, rounded_rectangle, slab
from kfit.data.shapes.textures import solid

EVEN = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))


def box(width: float = 2.0, height: float = 1.0, depth: float = 3.0) -> Mesh:
    tiles = tuple(solid(np.eye(3)[k]) for k in range(3))
    return join(slab(rounded_rectangle(width, depth, 0.01), 0.0, height, 0.001, tiles))


def test_a_normalised_mesh_is_centred_and_has_a_unit_diagonal():
    mesh = box().normalised()
    low, high = mesh.bounds
    np.testing.assert_allclose(low + high, 0, atol=1e-6)
    assert np.linalg.norm(high - low) == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(mesh.extents, np.array([2, 1, 3]) / np.sqrt(14), atol=1e-5)
    np.testing.assert_allclose(box().extents, mesh.extents, atol=1e-5)


def test_turning_a_mesh_turns_its_normals():
    mesh = plate(rounded_rectangle(1, 1, 0.1), 0.5, solid(np.ones(3))).transformed(shift(1, 2, 3) @ turn_x(np.pi / 2))
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1.0], (len(mesh.normals), 1)), atol=1e-6)
    np.testing.assert_allclose(mesh.vertices[:, 2], 3.5, atol=1e-6)


def test_every_part_keeps_its_own_colour_in_the_atlas():
    colors = [np.array(c) for c in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0))]
    square = rounded_rectangle(0.2, 0.2, 0.0)
    parts = [
        plate(square, 0.0, solid(color)).transformed(shift(0.3 * k - 0.45, 0, 0) @ turn_x(np.pi / 2))
        for k, color in enumerate(colors)
    ]
    image = pose_view(join(parts), 0, 0, EVEN, image_size=80).image
    for k, color in enumerate(colors):
        column = round(39.5 + (0.3 * k - 0.45) * 0.95 * 80)
        np.testing.assert_allclose(image[40, column], color, atol=0.01)


def test_surfaces_of_solids_look_outwards():
    mesh = box().normalised()
    assert ((mesh.vertices * mesh.normals).sum(axis=1) > 0).all()


def test_the_floor_of_a_beaker_sees_less_than_its_outside():
    wall = np.stack([np.full(20, 0.2), np.linspace(-0.4, 0.4, 20)], axis=1)
    inside = np.stack([np.full(20, 0.15), np.linspace(0.4, -0.35, 20)], axis=1)
    floor = np.stack([np.linspace(0.15, 0, 6), np.full(6, -0.35)], axis=1)
    lip = np.array([[0.2, 0.4], [0.15, 0.4]])
    under = np.stack([np.linspace(0, 0.2, 6), np.full(6, -0.4)], axis=1)
    white = solid(np.ones(3))
    mesh = with_exposure(join([revolve(p, white) for p in (wall, inside, floor, lip, under)]))
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2])
    outside = mesh.exposure[(radius > 0.19) & (np.abs(mesh.vertices[:, 1]) < 0.3)]
    deep = mesh.exposure[(radius < 0.1) & (mesh.vertices[:, 1] > -0.36)]
    assert outside.min() > 0.9
    assert deep.max() < 0.55


def test_both_sides_count_only_where_a_surface_is_open():
    solid_box = box().normalised()
    sheet = plate(rounded_rectangle(1, 1, 0.1), 0.0, solid(np.ones(3)))
    np.testing.assert_array_equal(
        with_exposure(solid_box, two_sided=None).exposure, with_exposure(solid_box, two_sided=False).exposure
    )
    np.testing.assert_allclose(with_exposure(sheet.transformed(turn_y(0.3)), two_sided=None).exposure, 1, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"normals": np.zeros((2, 3), np.float32)}, "normals must have shape"),
        ({"faces": np.array([[0, 1, 9]], np.int32)}, "faces must index 3 vertices"),
        ({"faces": np.zeros((0, 3), np.int32)}, "faces must be"),
        ({"texture": np.zeros((4, 4, 3), np.float32)}, "texture must be"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, message):
    good = {
        "vertices": np.eye(3, dtype=np.float32),
        "faces": np.array([[0, 1, 2]], np.int32),
        "normals": np.eye(3, dtype=np.float32),
        "uv": np.zeros((3, 2), np.float32),
        "texture": np.zeros((4, 4, 3), np.uint8),
    }
    Mesh(**good)
    with pytest.raises(ValueError, match=message):
        Mesh(**{**good, **change})


def test_joining_nothing_is_refused():
    with pytest.raises(ValueError, match="parts must hold"):
        join([])
