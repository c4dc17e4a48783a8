"""The rasterizer against analytic spheres and plates, and the signs of the angles."""

import numpy as np
import pytest

from kfit.data.light import Light
from kfit.data.mesh import Mesh
from kfit.data.rasterizer import pose_view, render, standard_intrinsics, standard_pose
from kfit.data.shapes.placing import turn_x
from kfit.data.shapes.primitives import plate, rounded_rectangle
from kfit.data.shapes.textures import solid

EVEN = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
GREY = solid(np.full(3, 0.5))


def sphere(radius: float = 0.4, num: int = 160) -> Mesh:
    from kfit.data.shapes.primitives import revolve

    angle = np.linspace(-np.pi / 2, np.pi / 2, num)
    return revolve(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), GREY, num)


def analytic_depth(intrinsics: np.ndarray, size: tuple[int, int], distance: float, radius: float) -> np.ndarray:
    rows, columns = np.mgrid[: size[0], : size[1]]
    x = (columns - intrinsics[0, 2]) / intrinsics[0, 0]
    y = (rows - intrinsics[1, 2]) / intrinsics[1, 1]
    # |t·(x, −y, −1) + (0, 0, distance)|² = radius², and t is the depth.
    a, b, c = x**2 + y**2 + 1, -distance, distance**2 - radius**2
    root = b**2 - a * c
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, 0)


@pytest.mark.parametrize(
    "intrinsics",
    [standard_intrinsics(64), np.array([[230.0, 0, 30.0], [0, 260.0, 36.5], [0, 0, 1]])],
    ids=["standard camera", "oblong pixels and an axis off the centre"],
)
def test_depth_of_a_sphere_is_the_analytic_one(intrinsics):
    view = render(sphere(), standard_pose(0, 0), intrinsics, (72, 64), EVEN, supersample=1)
    expected = analytic_depth(intrinsics, (72, 64), 4.0, 0.4)
    inside = (expected > 0) & (expected < 3.85)
    assert inside.sum() > 500
    np.testing.assert_allclose(view.depth[inside], expected[inside], atol=5e-4)
    assert ((view.depth > 0) != (expected > 0)).mean() < 0.01


def test_coordinates_lie_on_the_sphere_and_project_back_to_their_pixels():
    pose, intrinsics = standard_pose(0.4, 1.1), standard_intrinsics(64)
    view = render(sphere(), pose, intrinsics, (64, 64), EVEN)
    inside = view.mask == 1
    np.testing.assert_allclose(np.linalg.norm(view.coords[inside], axis=1), 0.4, atol=5e-3)
    camera = view.coords[inside] @ pose[:3, :3].T + pose[:3, 3]
    rows, columns = np.nonzero(inside)
    np.testing.assert_allclose(intrinsics[0, 0] * camera[:, 0] / -camera[:, 2] + intrinsics[0, 2], columns, atol=1e-3)
    np.testing.assert_allclose(-intrinsics[1, 1] * camera[:, 1] / -camera[:, 2] + intrinsics[1, 2], rows, atol=1e-3)
    np.testing.assert_allclose(-camera[:, 2], view.depth[inside], atol=1e-5)
    assert not view.coords[view.mask == 0].any()


def test_mask_covers_the_area_of_a_plate_and_colours_blend_with_white_by_it():
    square = plate(rounded_rectangle(0.5, 0.5, 0.0), 0.0, GREY).transformed(turn_x(np.pi / 2))
    view = pose_view(square, 0, 0, EVEN, image_size=64, supersample=4)
    focal = standard_intrinsics(64)[0, 0]
    assert view.mask.sum() == pytest.approx((focal * 0.5 / 4) ** 2, rel=0.02)
    blended = 1 - view.mask * (1 - 128 / 255)
    np.testing.assert_allclose(view.image, np.stack([blended] * 3, axis=2), atol=1e-5)


@pytest.mark.parametrize("distance", [1.3, 4.0, 8.0])
def test_the_unit_sphere_spans_the_stated_share_of_the_picture_at_any_distance(distance):
    view = pose_view(sphere(0.5), 0, 0, EVEN, 100, distance, unit_fraction=0.9, supersample=4)
    assert view.mask.sum(axis=1).max() == pytest.approx(90, abs=0.6)
    assert view.mask.sum(axis=0).max() == pytest.approx(90, abs=0.6)
    assert view.depth[50, 50] == pytest.approx(distance - 0.5, abs=2e-3)


def spot(position: tuple[float, float, float]) -> Mesh:
    ball = sphere(0.03, 16)
    return Mesh(ball.vertices + np.float32(position), ball.faces, ball.normals, ball.uv, ball.texture)


def where(position: tuple[float, float, float], elevation: float, azimuth: float) -> tuple[float, float]:
    mask = pose_view(spot(position), elevation, azimuth, EVEN).mask
    rows, columns = np.nonzero(mask)
    return float(columns.mean() - 31.5), float(31.5 - rows.mean())


def test_at_zero_angles_x_is_to_the_right_and_y_is_up():
    assert where((0.3, 0, 0), 0, 0)[0] > 10
    assert where((0, 0.3, 0), 0, 0)[1] > 10


def test_a_quarter_azimuth_brings_z_to_the_right():
    right, up = where((0, 0, 0.3), 0, np.pi / 2)
    assert right > 10
    assert abs(up) < 1


def test_a_positive_elevation_tips_the_top_towards_the_viewer():
    top, bottom = pose_view(spot((0, 0.4, 0)), 0.8, 0, EVEN), pose_view(spot((0, -0.4, 0)), 0.8, 0, EVEN)
    assert top.depth[top.mask > 0].mean() < 3.8 < 4.2 < bottom.depth[bottom.mask > 0].mean()


def test_both_sides_of_a_thin_wall_are_lit_alike_by_even_light():
    square = plate(rounded_rectangle(0.5, 0.5, 0.0), 0.0, GREY).transformed(turn_x(np.pi / 2))
    front, back = pose_view(square, 0, 0, EVEN), pose_view(square, 0, np.pi, EVEN)
    assert front.image[32, 32] == pytest.approx(back.image[32, 32])


def test_texture_reads_from_left_to_right_and_from_top_to_bottom():
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:4, :4] = (255, 0, 0)
    square = plate(rounded_rectangle(0.6, 0.6, 0.0), 0.0, texture).transformed(turn_x(np.pi / 2))
    image = pose_view(square, 0, 0, EVEN).image
    assert image[24, 24, 0] == pytest.approx(1)
    assert max(image[24, 40, 0], image[40, 24, 0], image[40, 40, 0]) == pytest.approx(0)


def test_a_lamp_stays_with_the_object_when_it_turns():
    lamp = Light(np.full(3, 0.2), np.array([[1.0, 0, 0]]), np.ones((1, 3)))
    lit = pose_view(sphere(), 0, -np.pi / 2, lamp).image
    unlit = pose_view(sphere(), 0, np.pi / 2, lamp).image
    assert lit[32, 32, 0] > unlit[32, 32, 0] + 0.3


def test_a_mesh_that_reaches_behind_the_camera_is_refused():
    with pytest.raises(ValueError, match="in front of the camera"):
        render(sphere(), standard_pose(0, 0, 0.3), standard_intrinsics(64), (64, 64), EVEN)
    with pytest.raises(ValueError, match="distance must lie between 1"):
        pose_view(sphere(), 0, 0, EVEN, distance=0.3)
    with pytest.raises(ValueError, match="distance must lie between 1"):
        standard_intrinsics(64, 0.3)
