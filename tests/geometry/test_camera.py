import math

import pytest
import torch

from kfit.geometry import (
    UNIT_FRACTION,
    Crop,
    angles_from_rotation,
    box_corners,
    depth_along,
    diagonal_at,
    distance_by_focal,
    focal_by_distance,
    from_opencv,
    intrinsics_from_exif,
    intrinsics_from_fov,
    pose_from_crop,
    project,
    rotation_error,
    rotation_from_angles,
    to_opencv,
    viewing_ray,
    viewing_ray_rotation,
    was_cropped,
    with_focal,
)

WIDTH, HEIGHT = 1200, 900
SIZE = torch.tensor([0.10, 0.08, 0.06], dtype=torch.float64)
DIAGONAL = float(SIZE.norm())
INTRINSICS = intrinsics_from_fov(WIDTH, HEIGHT).double()


def ideal_fit(rotation: torch.Tensor, translation: torch.Tensor, crop: Crop) -> tuple[torch.Tensor, ...]:
    """What a perfect fit finds: the similarity between the photo and a camera that looks straight at the object."""
    centre = project(translation[None], INTRINSICS)[0]
    turn = viewing_ray_rotation(centre, INTRINSICS)
    distance = translation.norm()
    straight = torch.stack((torch.zeros_like(distance), torch.zeros_like(distance), distance))
    # In the generator's picture the silhouette of a ball of unit diameter is UNIT_FRACTION of the width.
    focal = UNIT_FRACTION * crop.side * ((distance / DIAGONAL) ** 2 - 1 / 4).sqrt()
    camera = torch.diag(torch.stack((focal, focal, torch.ones_like(focal))))
    drawn = project(box_corners(turn.mT @ rotation, straight, SIZE), camera)
    observed = project(box_corners(rotation, translation, SIZE), INTRINSICS) - centre
    # Least-squares scale and turn between the two, as complex numbers.
    z, w = torch.view_as_complex(drawn.contiguous()), torch.view_as_complex(observed.contiguous())
    factor = (z.conj() * w).sum() / (z.abs() ** 2).sum()
    azimuth, elevation, roll = angles_from_rotation(from_opencv(turn.mT @ rotation))
    middle = torch.tensor(crop.centre, dtype=torch.float64)
    shift = (centre - middle) / (crop.side / 2) * torch.tensor([1.0, -1.0])
    # y is down in the photo, so an angle there has the other sign.
    return azimuth, elevation, roll - factor.angle(), shift, factor.abs()


def poses(offset: float) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Objects at several distances whose ray lies ``offset`` degrees off the axis, in several directions."""
    made = []
    for k, distance in enumerate((0.4, 0.6, 1.0, 2.0)):
        around = torch.tensor(0.4 + 2 * k, dtype=torch.float64)
        off = torch.tensor(math.radians(offset), dtype=torch.float64)
        ray = torch.stack((off.sin() * around.cos(), off.sin() * around.sin(), off.cos()))
        angles = (torch.tensor(v, dtype=torch.float64) for v in (0.7 + k, 0.5, 0.1 * k))
        made.append((to_opencv(rotation_from_angles(*angles)), distance * ray))
    return made


def recovered(rotation: torch.Tensor, translation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    corners = project(box_corners(rotation, translation, SIZE), INTRINSICS)
    low, high = corners.amin(0), corners.amax(0)
    x, y = ((low + high) / 2).tolist()
    crop = Crop((x, y), 1.3 * float((high - low).max()))
    azimuth, elevation, roll, shift, scale = (v[None] for v in ideal_fit(rotation, translation, crop))
    found = pose_from_crop(azimuth, elevation, roll, shift, scale, crop, INTRINSICS, DIAGONAL)
    return found[0][0], found[1][0]


def test_on_the_axis_the_pose_comes_back_exactly() -> None:
    for rotation, translation in poses(0):
        found, moved = recovered(rotation, translation)
        assert float(rotation_error(found, rotation)) < 1e-6
        torch.testing.assert_close(moved, translation, atol=1e-7, rtol=1e-6)


@pytest.mark.parametrize(("offset", "share", "degrees"), [(5, 0.002, 0.1), (15, 0.01, 0.5), (25, 0.02, 1.5)])
def test_off_the_axis_the_pose_comes_back_nearly(offset: float, share: float, degrees: float) -> None:
    for rotation, translation in poses(offset):
        found, moved = recovered(rotation, translation)
        assert math.degrees(float(rotation_error(found, rotation))) < degrees
        assert float((moved - translation).norm() / translation.norm()) < share
        # The ray is right to the last digit, only the distance along it is not.
        torch.testing.assert_close(moved / moved.norm(), translation / translation.norm())


def test_without_the_rays_rotation_the_error_would_be_the_rays_angle() -> None:
    rotation, translation = poses(20)[1]
    pixel = project(translation[None], INTRINSICS)[0]
    turn = viewing_ray_rotation(pixel, INTRINSICS)
    assert math.degrees(float(rotation_error(turn.mT @ rotation, rotation))) == pytest.approx(20, abs=1e-4)


def test_rows_are_independent_and_diagonals_may_differ() -> None:
    torch.manual_seed(0)
    azimuth, elevation, roll, scale = torch.rand(4, 3) + 0.1
    shift = torch.rand(3, 2)
    crop, intrinsics, diagonal = Crop((300.0, 200.0), 128.0), INTRINSICS.float(), torch.tensor([0.1, 0.2, 0.3])
    rotation, translation = pose_from_crop(azimuth, elevation, roll, shift, scale, crop, intrinsics, diagonal)
    assert rotation.shape == (3, 3, 3)
    assert translation.shape == (3, 3)
    one = slice(1, 2)
    alone = pose_from_crop(azimuth[one], elevation[one], roll[one], shift[one], scale[one], crop, intrinsics, 0.2)
    torch.testing.assert_close(rotation[1:2], alone[0])
    torch.testing.assert_close(translation[1:2], alone[1])


def test_twice_the_scale_is_half_the_distance_but_for_the_perspective() -> None:
    zero, one = torch.zeros(2), torch.tensor([1.0, 2.0])
    crop = Crop(((WIDTH - 1) / 2, (HEIGHT - 1) / 2), 190.0)
    _, moved = pose_from_crop(zero, zero, zero, torch.zeros(2, 2), one, crop, INTRINSICS.float(), 0.3)
    focal = float(INTRINSICS[0, 0])
    far = torch.tensor([1.0, 0.5]) * focal / (0.95 * 190)
    torch.testing.assert_close(moved[:, 2], 0.3 * (far**2 + 1 / 4).sqrt())


def test_a_ball_seen_from_any_distance_spans_the_same_share_of_the_picture() -> None:
    distance = torch.tensor([0.6, 1.3, 4.0, 50.0], dtype=torch.float64)
    focal = focal_by_distance(distance, 1.1)
    # The ray that touches a ball of radius 1/2 has the sine 1 / 2d.
    torch.testing.assert_close(2 * focal * torch.asin(0.5 / distance).tan(), torch.full_like(focal, 1.1))
    torch.testing.assert_close(distance_by_focal(focal, 1.1), distance)


def test_a_camera_with_another_focal_length_keeps_its_centre_and_its_pixels_shape() -> None:
    camera = torch.tensor([[400.0, 2, 31], [0, 600, 20], [0, 0, 1]])
    found = with_focal(camera, torch.tensor([250.0]))
    torch.testing.assert_close(found, torch.tensor([[[200.0, 1, 31], [0, 300, 20], [0, 0, 1]]]))


def test_the_rays_rotation_takes_the_axis_to_the_ray_by_the_shortest_way() -> None:
    pixel = torch.tensor([[100.0, 80], [599.5, 449.5], [1000, 800]], dtype=torch.float64)
    rotation, ray = viewing_ray_rotation(pixel, INTRINSICS), viewing_ray(pixel, INTRINSICS)
    torch.testing.assert_close(rotation[..., 2], ray)
    torch.testing.assert_close(rotation_error(rotation, torch.eye(3).double()), torch.acos(ray[:, 2].clamp(max=1)))


def test_the_field_of_view_spans_the_longer_side() -> None:
    for width, height in ((1200, 900), (900, 1200)):
        intrinsics = intrinsics_from_fov(width, height, 60)
        assert float(intrinsics[0, 0]) == pytest.approx(600 / math.tan(math.radians(30)))
        assert intrinsics[:2, 2].tolist() == [(width - 1) / 2, (height - 1) / 2]


def test_an_impossible_field_of_view_is_refused() -> None:
    with pytest.raises(ValueError, match="fov_deg must lie between 1 and 179, got 190"):
        intrinsics_from_fov(100, 80, 190)


def test_the_focal_length_on_film_compares_diagonals() -> None:
    intrinsics = intrinsics_from_exif({0xA405: 26}, 4032, 3024)
    # A 26 mm lens sees 2 atan(43.267 / 52) = 79.5° from corner to corner.
    assert intrinsics is not None
    assert math.degrees(2 * math.atan(5040 / 2 / float(intrinsics[0, 0]))) == pytest.approx(79.5, abs=0.1)


def test_the_focal_planes_resolution_serves_where_film_does_not() -> None:
    # 50 mm on a 22.3 mm wide sensor of 5472 pixels, the photo shrunk to a quarter since.
    tags = {0x920A: 50.0, 0xA20E: 5472 / 22.3 * 25.4, 0xA210: 2, 0xA002: 5472, 0xA003: 3648, 0xA405: 0}
    intrinsics = intrinsics_from_exif(tags, 1368, 912)
    assert intrinsics is not None
    assert float(intrinsics[0, 0]) == pytest.approx(50 / 22.3 * 1368, rel=1e-5)


def test_a_cropped_photo_keeps_its_focal_length_in_pixels() -> None:
    tags = {0xA405: 27, 0xA002: 4080, 0xA003: 3060}
    whole, part = intrinsics_from_exif(tags, 4080, 3060), intrinsics_from_exif(tags, 2802, 2516)
    assert whole is not None
    assert part is not None
    assert float(part[0, 0]) == float(whole[0, 0]) == pytest.approx(3182.6, abs=0.1)
    assert was_cropped(tags, 2802, 2516)


@pytest.mark.parametrize("size", [(1020, 765), (765, 1020), (4080, 3060), (8160, 6120), (1021, 765)])
def test_a_photo_of_the_same_proportions_was_scaled(size: tuple[int, int]) -> None:
    tags = {0xA405: 27, 0xA002: 4080, 0xA003: 3060}
    found = intrinsics_from_exif(tags, *size)
    assert found is not None
    assert not was_cropped(tags, *size)
    assert float(found[0, 0]) == pytest.approx(3182.6 * max(size) / 4080, rel=1e-4)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {0xA405: 0},
        {0xA405: "wide"},
        {0xA405: float("nan")},
        {0x920A: 4.2},
        {0x920A: 4.2, 0xA20E: 0},
        {0xA405: None},
    ],
)
def test_tags_that_do_not_tell_give_nothing(tags: dict[int, object]) -> None:
    assert intrinsics_from_exif(tags, 100, 80) is None


def test_the_diagonal_at_a_distance_is_what_puts_the_object_there():
    crop, zero = Crop((400.0, 500.0), 300.0), torch.zeros(2, dtype=torch.float64)
    shift, scale = torch.tensor([[0.1, -0.2], [0.0, 0.3]], dtype=torch.float64), torch.tensor([0.8, 1.3]).double()
    distance = torch.tensor([0.7, 1.9], dtype=torch.float64)
    diagonal = diagonal_at(distance, shift, scale, crop, INTRINSICS)
    _, found = pose_from_crop(zero, zero, zero, shift, scale, crop, INTRINSICS, diagonal)
    torch.testing.assert_close(found.norm(dim=-1), distance)


def test_depth_along_a_ray_is_that_of_the_points_turned_to_it():
    pixel = torch.tensor([3.0, 1.0], dtype=torch.float64)
    camera = torch.tensor([[8.0, 0, 2], [0, 9.0, 2], [0, 0, 1]], dtype=torch.float64)
    depth = torch.linspace(1, 2, 24, dtype=torch.float64).view(4, 6)
    found = depth_along(depth, pixel, camera)
    turn = viewing_ray_rotation(pixel, camera)
    for v in range(4):
        for u in range(6):
            point = depth[v, u] * torch.tensor([(u - 2) / 8, (v - 2) / 9, 1.0], dtype=torch.float64)
            torch.testing.assert_close(found[v, u], (turn.mT @ point)[2])
