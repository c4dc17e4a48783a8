"""From coordinates and depth to a pose, on the rasterizer's own pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from kfit.baselines import coordinate_pose, pose_of_coordinates
from kfit.data import build, render
from kfit.data.rasterizer import standard_intrinsics, standard_pose
from kfit.geometry import Crop, observed, rotation_error, to_opencv

DIAGONAL = 0.21
SHIFT = (0.5, -0.3)  # of the object from the axis, in diagonals: its rays are not the camera's axis


@pytest.fixture(scope="module")
def object_view() -> dict[str, Tensor]:
    """A mug beside the axis of a photo, cut out, with its coordinates, camera and true pose."""
    mesh, light = build("mug", 5)
    world2cam, camera = standard_pose(0.6, 0.8), standard_intrinsics(200)
    world2cam[:2, 3] = SHIFT
    view = render(mesh, world2cam, camera, (200, 200), light)
    crop, photo_camera = Crop.around(view.mask), torch.from_numpy(camera)
    piece = observed(crop, view.image, view.mask, DIAGONAL * view.depth, photo_camera)
    # Coordinates in the crop follow from its depth, so they are those of the crop's pixels.
    intrinsics = piece.field("intrinsics")[0]
    points = torch.from_numpy(coordinate_pose._points(piece.depth[0, 0], intrinsics))
    rotation = to_opencv(torch.from_numpy(world2cam[:3, :3]))
    translation = DIAGONAL * torch.from_numpy(world2cam[:3, 3] * [1, -1, -1])
    coordinates = ((points - translation) @ rotation / DIAGONAL).movedim(-1, 0)
    return {
        "coordinates": coordinates.nan_to_num().float(), "mask": piece.mask[0, 0], "depth": piece.depth[0, 0],
        "intrinsics": intrinsics, "rotation": rotation, "translation": translation,
        "true": torch.from_numpy(view.coords), "to_photo": crop.crop_to_image,
    }  # fmt: skip


def pose(object_view: dict[str, Tensor], **changes) -> tuple[Tensor, Tensor, float]:
    return pose_of_coordinates(*({**object_view, **changes}[n] for n in ("coordinates", "mask", "depth", "intrinsics")))


def test_the_depth_along_the_middle_s_ray_gives_the_points_that_the_rasterizer_saw(
    object_view: dict[str, Tensor],
) -> None:
    pixel = torch.tensor([30.0, 34.0, 1.0], dtype=torch.float64)
    x, y, _ = (object_view["to_photo"] @ pixel).round().long().tolist()
    assert object_view["mask"][34, 30] == 1
    torch.testing.assert_close(
        object_view["coordinates"][:, 34, 30], object_view["true"][y, x].float(), atol=0.01, rtol=0
    )


def test_true_coordinates_give_the_pose_and_size(object_view: dict[str, Tensor]) -> None:
    rotation, translation, diagonal = pose(object_view)
    assert rotation_error(rotation, object_view["rotation"]).rad2deg() < 0.2
    torch.testing.assert_close(translation, object_view["translation"], atol=5e-4, rtol=0)
    assert diagonal == pytest.approx(DIAGONAL, rel=5e-3)
    torch.testing.assert_close(rotation @ rotation.mT, torch.eye(3, dtype=torch.float64), atol=1e-9, rtol=0)


def test_wrong_pixels_and_unknown_depth_do_not_matter(object_view: dict[str, Tensor]) -> None:
    rng = np.random.default_rng(0)
    wrong, unknown = (torch.from_numpy(rng.random((64, 64)) < 0.25) for _ in range(2))
    noise = torch.from_numpy(rng.uniform(-0.5, 0.5, (3, 64, 64))).float()
    coordinates = object_view["coordinates"].where(~wrong, noise)
    depth = object_view["depth"].masked_fill(unknown, math.nan).masked_fill(torch.rand(64, 64) < 0.1, 0.0)
    rotation, translation, diagonal = pose(object_view, coordinates=coordinates, depth=depth)
    assert rotation_error(rotation, object_view["rotation"]).rad2deg() < 2
    torch.testing.assert_close(translation, object_view["translation"], atol=5e-3, rtol=0)
    assert diagonal == pytest.approx(DIAGONAL, rel=0.03)


def test_icp_brings_a_cloud_back_that_has_been_moved(object_view: dict[str, Tensor]) -> None:
    points = coordinate_pose._points(object_view["depth"], object_view["intrinsics"])
    known = (object_view["mask"] > 0.5).numpy() & np.isfinite(points).all(-1)
    turn = standard_pose(0.03, 0.05)[:3, :3]
    middle = points[known].mean(0)
    moved = (points - middle) @ turn.T + middle + [0.003, -0.002, 0.004]
    back = coordinate_pose._refined(moved, points, known, 0.02)
    before = np.linalg.norm(moved[known] - points[known], axis=1).mean()
    after = np.linalg.norm(moved[known] @ back[:3, :3].T + back[:3, 3] - points[known], axis=1).mean()
    assert after < 0.3 * before


def test_icp_that_does_not_bring_clouds_closer_is_left_out(object_view: dict[str, Tensor], monkeypatch) -> None:
    class Astray:
        def __init__(self, *settings):
            pass

        def registerModelToScene(self, source, target):
            away = np.eye(4)
            away[:3, 3] = 0.1
            return 0, 0.0, away

    plain = pose_of_coordinates(*(object_view[n] for n in ("coordinates", "mask", "depth", "intrinsics")), refine=False)
    monkeypatch.setattr(coordinate_pose.cv2.ppf_match_3d, "ICP", Astray)
    torch.testing.assert_close(pose(object_view)[:2], plain[:2])


def test_too_little_depth_is_reported(object_view: dict[str, Tensor]) -> None:
    with pytest.raises(ValueError, match="depth: 0 pixels of the object have it, and at least 16 are needed"):
        pose(object_view, depth=torch.full((64, 64), math.nan))


def test_coordinates_that_fit_no_similarity_are_reported(object_view: dict[str, Tensor]) -> None:
    wild = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0)) - 0.5
    with pytest.raises(ValueError, match="no similarity brings a tenth of"):
        pose(object_view, coordinates=wild)


def test_shapes_that_do_not_fit_are_reported(object_view: dict[str, Tensor]) -> None:
    with pytest.raises(ValueError, match=r"depth must have shape \(64, 64\), got \(1, 64, 64\)"):
        pose(object_view, depth=object_view["depth"][None])
