"""One object in several photos by cameras that are known to one another."""

import numpy as np
import pytest
import torch

import kfit
from kfit.core import Observation
from kfit.data import build, pose_view
from kfit.generators import MultiView, RadianceField, SimilarityWarp
from kfit.geometry import distance_by_focal, focal_by_distance, rotation_error, rotation_from_angles, to_opencv

SIZE, DIAGONAL = 128, 0.14
FOCAL = SIZE * float(focal_by_distance(torch.tensor(4.0)))
CAMERA = torch.tensor([[FOCAL, 0, 63.5], [0, FOCAL, 63.5], [0, 0, 1.0]])


def object_pose(azimuth, elevation):
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = to_opencv(rotation_from_angles(*(torch.tensor(a).double() for a in (azimuth, elevation, 0.0))))
    pose[2, 3] = 4 * DIAGONAL
    return pose


def two_views(directions=((0.6, 0.5), (1.5, 0.4))):
    mesh, light = build("mug", 7)
    views = [pose_view(mesh, elevation, azimuth, light, SIZE) for azimuth, elevation in directions]
    poses = torch.stack([object_pose(*direction) for direction in directions])
    return views, poses, poses @ torch.linalg.inv(poses[0])


def test_the_reference_view_is_drawn_as_it_is_without_others():
    torch.manual_seed(0)
    warped = SimilarityWarp(RadianceField(code_dim=3, volume_dims=(4, 3), num_samples=4, image_size=16)).double()
    camera = torch.tensor([[60.0, 0, 7.5], [0, 60.0, 7.5], [0, 0, 1]]).double()
    views = MultiView(warped, 16, 1.0)
    values = {
        "code": torch.randn(2, 3).double(),
        "azimuth": torch.tensor([0.3, -1.0]).double(),
        "elevation": torch.tensor([0.4, 0.2]).double(),
        "roll": torch.tensor([0.1, 0.0]).double(),
        "shift": torch.tensor([[0.1, -0.05], [0.0, 0.0]]).double(),
        "scale": torch.tensor([0.9, 1.0]).double(),
        "focal": torch.tensor([60 / 16, 60 / 16]).double(),
    }
    quarter = torch.eye(4).double()
    quarter[:3, :3] = (
        to_opencv(torch.eye(3).double())
        @ rotation_from_angles(*(torch.tensor(a).double() for a in (0.7, 0.0, 0.0)))
        @ to_opencv(torch.eye(3).double())
    )
    away = 0.2 * float(distance_by_focal(values["focal"][1], 1.0))
    centre = torch.tensor([0.0, 0.0, away]).double()  # where the second row's object is
    quarter[:3, 3] = centre - quarter[:3, :3] @ centre
    context = {
        "intrinsics": camera.expand(2, 2, 3, 3),
        "trans_cam_ref": torch.stack([torch.eye(4).double(), quarter]).expand(2, 2, 4, 4),
    }
    drawn = views(**values, diagonal=torch.tensor([0.2, 0.2]).double(), **context)
    torch.testing.assert_close(drawn.image[::2], warped(**values).image, rtol=0, atol=1e-6)
    # Upright in the middle, an object before a camera that goes round it turns about its own axis.
    level = values | {"elevation": 0 * values["elevation"]}
    drawn = views(**level, diagonal=torch.tensor([0.2, 0.2]).double(), **context)
    rotated = {name: value[1:] for name, value in level.items()}
    rotated["azimuth"] = rotated["azimuth"] + 0.7
    torch.testing.assert_close(drawn.image[3:], warped(**rotated).image, rtol=0, atol=1e-6)


def test_a_view_through_a_lens_twice_as_long_is_drawn_twice_as_large():
    torch.manual_seed(0)
    warped = SimilarityWarp(RadianceField(code_dim=3, volume_dims=(4, 3), num_samples=4, image_size=16)).double()
    cameras = torch.tensor([[60.0, 0, 7.5], [0, 60.0, 7.5], [0, 0, 1]]).double().repeat(1, 2, 1, 1)
    cameras[0, 1, :2, :2] *= 2
    values = {name: torch.zeros(1, *variable.shape).double() for name, variable in warped.variables.items()}
    # The reference's focal length is the fit's to change, and the other's follows.
    values |= {"scale": torch.tensor([0.5]).double(), "focal": torch.tensor([5.0]).double()}
    context = {"intrinsics": cameras, "trans_cam_ref": torch.eye(4).double().expand(1, 2, 4, 4)}
    drawn = MultiView(warped, 16, 1.0)(**values, diagonal=torch.tensor([0.2]).double(), **context).image
    twice = values | {"scale": 2 * values["scale"], "focal": 2 * values["focal"]}
    expected = torch.cat([warped(**values).image, warped(**twice).image])
    torch.testing.assert_close(drawn, expected, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_two_photos_give_the_pose_and_the_size_without_depth():
    views, poses, relative = two_views()
    result = kfit.load("mug").pose(
        [view.image for view in views],
        mask=[view.mask for view in views],
        intrinsics=CAMERA,
        relative_poses=relative,
    )
    truth = poses[0, :3, :3]
    assert float(torch.rad2deg(rotation_error(torch.from_numpy(result.rotation), truth))) < 10
    assert float(np.linalg.norm(result.size)) == pytest.approx(DIAGONAL, rel=0.15)
    assert result.translation == pytest.approx([0, 0, 4 * DIAGONAL], abs=0.08)
    assert result.size_from == "views"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"relative_poses": None}, "several photos need relative_poses"),
        ({"relative_poses": torch.eye(4).expand(3, 4, 4)}, r"relative_poses must have shape \(2, 4, 4\)"),
        ({"relative_poses": 2 * torch.eye(4).expand(2, 4, 4)}, "must be rigid motions"),
        ({"relative_poses": torch.eye(4).expand(2, 4, 4), "mask": [np.ones((8, 8))]}, "mask must hold one for each"),
        ({"depth": np.ones((8, 8))}, "depth and several photos were both given"),
    ],
)
def test_views_that_do_not_go_together_are_refused(change, message):
    photos = [np.random.default_rng(0).random((8, 8, 3)) for _ in range(2)]
    with pytest.raises(ValueError, match=message):
        kfit.load("mug").pose(photos, **{"mask": [np.ones((8, 8))] * 2, "intrinsics": CAMERA} | change)


def test_observations_of_several_views_have_a_problem_of_each():
    observation = Observation(torch.zeros(6, 3, 4, 4), views=3, keys=(1, 2))
    assert observation.num_problems == 2
    assert observation.first_views().image.shape[0] == 2
    assert observation.first_views().views == 1
