"""A known mesh before real cameras, held against the exact rasterizer and against pinhole geometry."""

import numpy as np
import pytest
import torch

from kfit import FitPipeline
from kfit.core import SO3, Observation
from kfit.data import Light, build, pose_view
from kfit.energies import L2, Silhouette
from kfit.generators import MeshInCamera
from kfit.geometry import rotation_error, rotation_from_angles, to_opencv
from kfit.initializers import Constant
from kfit.optimizers import Adam

# 64 pixels across, as the rasterizer draws: a unit diagonal spans 0.95 of the picture at 4 diagonals.
CAMERA = torch.tensor([[0.95 * 64 * 4, 0.0, 31.5], [0.0, 0.95 * 64 * 4, 31.5], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def mug():
    return build("mug", 7)[0]


def generator(mesh, size=(64, 64), intrinsics=CAMERA, num_points=8192):
    return MeshInCamera(mesh.vertices, mesh.faces, mesh.uv, mesh.texture, size, intrinsics, num_points)


def pose(azimuth=0.5, elevation=0.4, place=(0.0, 0.0, 4.0)):
    rotation = to_opencv(rotation_from_angles(*(torch.tensor([a]) for a in (azimuth, elevation, 0.0))))
    return {"rotation": rotation, "translation": torch.tensor([place])}


def test_mask_and_depth_are_those_of_an_exact_rasterizer(mug):
    even = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
    view = pose_view(mug, 0.4, 0.5, even, supersample=4)
    mask, depth = torch.from_numpy(view.mask), torch.from_numpy(view.depth)
    drawn = generator(mug)(**pose())
    overlap = torch.minimum(drawn.mask[0, 0], mask).sum() / torch.maximum(drawn.mask[0, 0], mask).sum()
    assert float(overlap) > 0.95
    assert float((drawn.depth[0, 0] - depth)[mask == 1].abs().median()) < 0.015


def test_any_size_and_camera_show_the_same_object_by_pinhole_geometry(mug):
    place = torch.tensor([0.6, -0.3, 4.0])
    wide = torch.tensor([[200.0, 0.0, 70.0], [0.0, 150.0, 40.0], [0.0, 0.0, 1.0]])
    drawn = generator(mug, (90, 160), wide)(**pose(place=place.tolist()))
    assert drawn.image.shape == (1, 3, 90, 160)
    vertices = torch.from_numpy(mug.vertices) @ pose()["rotation"][0].T + place
    pixels = (vertices @ wide.T)[:, :2] / vertices[:, 2:]
    rows, columns = (drawn.mask[0, 0] > 0.5).nonzero().unbind(1)
    for found, expected in ((columns, pixels[:, 0]), (rows, pixels[:, 1])):
        assert abs(float(found.min()) - float(expected.min())) < 1.5
        assert abs(float(found.max()) - float(expected.max())) < 1.5


def views(count=2):
    """Poses of cameras about the object, the first as the reference."""
    turns = SO3().to_value(torch.tensor([[0.0, 0.4 * k, 0.0] for k in range(count)]))
    middle = torch.tensor([0.0, 0.0, 4.0])
    moves = middle - turns @ middle
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3], poses[:, :3, 3] = turns, moves
    return poses


def test_several_views_are_drawn_one_after_another(mug):
    drawer, poses = generator(mug, num_points=2000), views()
    together = drawer(**pose(), trans_cam_ref=poses[None], intrinsics=CAMERA.expand(1, 2, 3, 3))
    assert together.image.shape[0] == 2
    for view in range(2):
        rotation = poses[view, :3, :3] @ pose()["rotation"]
        translation = pose()["translation"] @ poses[view, :3, :3].T + poses[view, :3, 3]
        alone = drawer(rotation=rotation, translation=translation)
        torch.testing.assert_close(together.image[view : view + 1], alone.image, rtol=0, atol=1e-4)
        torch.testing.assert_close(together.depth[view : view + 1], alone.depth, rtol=0, atol=1e-3)


@pytest.mark.slow
def test_two_views_find_a_pose_from_forty_degrees_away(mug):
    drawer, truth = generator(mug, num_points=4096), pose()
    drawn = drawer(**truth, trans_cam_ref=views()[None], intrinsics=CAMERA.expand(1, 2, 3, 3))
    observation = Observation(
        drawn.image, drawn.mask, intrinsics=CAMERA.expand(2, 3, 3), trans_cam_ref=views(), views=2
    )
    away = SO3().to_value(torch.tensor([0.0, 40 / 180, 0.0]))
    start = {"rotation": (truth["rotation"][0] @ away).tolist(), "translation": [0.1, -0.1, 4.4]}
    found = FitPipeline(
        drawer,
        {"outline": Silhouette(), "colour": L2()},
        [Constant(start, sigma={"rotation": 0.15})],
        Adam({"rotation": 0.01, "translation": 0.03}, decay=0.96),
        num_starts=4,
        num_candidates=64,
        num_steps=40,
    )(observation, seed=0)
    assert found.num_evaluations == 2 * (64 + 4 * 41)
    assert float(torch.rad2deg(rotation_error(found.values["rotation"], truth["rotation"]))) < 3
    assert float((found.values["translation"] - truth["translation"]).norm()) < 0.1


def test_what_is_missing_is_named(mug):
    with pytest.raises(ValueError, match="no intrinsics"):
        generator(mug, intrinsics=None).prepare(Observation(torch.zeros(1, 3, 64, 64)))
    with pytest.raises(ValueError, match="2 views must have trans_cam_ref"):
        generator(mug).prepare(Observation(torch.zeros(2, 3, 64, 64), views=2))
    with pytest.raises(ValueError, match="it needs intrinsics"):
        generator(mug, intrinsics=None)(**pose())
    with pytest.raises(ValueError, match="3 pictures"):
        Observation(torch.zeros(3, 3, 64, 64), views=2)


def test_what_lies_behind_the_camera_is_not_drawn(mug):
    drawn = generator(mug)(**pose(place=(0.0, 0.0, -4.0)))
    assert float(drawn.mask.max()) == 0
    assert bool((drawn.image == 1).all())
