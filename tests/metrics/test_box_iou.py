"""Overlaps of boxes: the published formula, hulls, and exact volumes against closed forms and counted points."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kfit.metrics import axis_aligned_iou, best_iou, nocs_iou, oriented_iou

UNIT = np.ones(3)


def at(translation=(0.0, 0.0, 0.0), rotation=None, scale=1.0):
    pose = np.eye(4)
    pose[:3, :3] = scale * (np.eye(3) if rotation is None else rotation.as_matrix())
    pose[:3, 3] = translation
    return pose


TILTED = Rotation.from_rotvec([0.4, -1.1, 0.7])


@pytest.mark.parametrize("iou", [axis_aligned_iou, oriented_iou])
@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5, 1.0, 1.5])
def test_shifted_cubes_overlap_by_what_is_left(iou, shift):
    expected = max(0, 1 - shift) / (1 + min(1, shift))
    assert iou(at(), UNIT, at((shift, 0, 0)), UNIT) == pytest.approx(expected, abs=1e-9)


def test_exact_overlap_does_not_change_with_the_camera():
    view = at((0.3, -0.2, 1.5), TILTED, 0.4)
    assert oriented_iou(view, UNIT, view @ at((0.25, 0, 0)), UNIT) == pytest.approx(0.6, abs=1e-9)
    assert oriented_iou(view, UNIT, view, UNIT / 2) == pytest.approx(1 / 8, abs=1e-9)
    assert axis_aligned_iou(view, UNIT, view @ at((0.25, 0, 0)), UNIT) != pytest.approx(0.6, abs=1e-2)


def test_a_cube_turned_by_an_eighth_shares_an_octagon():
    octagon = 2 * (2**0.5 - 1)
    rotated = at(rotation=Rotation.from_euler("z", 45, degrees=True))
    assert oriented_iou(at(), UNIT, rotated, UNIT) == pytest.approx(octagon / (2 - octagon), abs=1e-9)


def test_exact_overlap_is_the_share_of_points_in_both():
    size_a, size_b = np.array([0.8, 0.3, 0.5]), np.array([0.4, 0.7, 0.6])
    a, b = at((0.1, 0, 1), TILTED), at((0.2, 0.1, 1.05), Rotation.from_rotvec([-0.2, 0.5, 1.3]), 0.9)
    grid = (np.arange(64) + 0.5) / 64 - 0.5
    points = np.array(list(itertools.product(grid, grid, grid))) * size_a @ a[:3, :3].T + a[:3, 3]
    local = (points - b[:3, 3]) @ np.linalg.inv(b[:3, :3]).T
    shared = (np.abs(local) <= size_b / 2).all(1).mean() * size_a.prod()
    expected = shared / (size_a.prod() + size_b.prod() * 0.9**3 - shared)
    assert oriented_iou(a, size_a, b, size_b) == pytest.approx(expected, abs=2e-3)


def test_boxes_without_volume_or_pose_overlap_in_nothing():
    assert oriented_iou(at(), np.array([1.0, 0, 1]), at(), UNIT) == 0
    assert np.isnan(oriented_iou(at((np.nan, 0, 0)), UNIT, at(), UNIT))
    for kind in ("nocs", "axis_aligned", "oriented"):
        assert best_iou(kind, np.zeros((4, 4)), UNIT, at(), UNIT, symmetric=True) == 0


def test_the_published_overlap_compares_the_coordinates_of_each_corner():
    # The example of hughw19/NOCS_CVPR2019 issue 47: cubes of sides 1 and 0.5 about one centre overlap by 1/8, but the
    # three coordinates of two corners are equal, so those intervals have no length and 0/0 comes out.
    pose = at((1, 1, 1))
    with np.errstate(invalid="ignore"):
        assert np.isnan(nocs_iou(pose, UNIT, pose, UNIT / 2))
    assert axis_aligned_iou(pose, UNIT, pose, UNIT / 2) == pytest.approx(1 / 8)


def test_the_published_overlap_gives_the_published_numbers():
    # compute_3d_iou_new of utils.py in hughw19/NOCS_CVPR2019@f882eb88 on these arguments: laptop, then can.
    size_a, size_b = np.array([0.5, 0.6, 0.7]), np.array([0.55, 0.5, 0.7])
    a, b = at((0.1, -0.2, 0.9), TILTED, 0.3), at((0.12, -0.18, 0.93), Rotation.from_rotvec([0.3, 1, 0.8]), 0.32)
    assert best_iou("nocs", a, size_a, b, size_b, symmetric=False) == pytest.approx(PUBLISHED[0], abs=1e-12)
    assert best_iou("nocs", a, size_a, b, size_b, symmetric=True) == pytest.approx(PUBLISHED[1], abs=1e-12)


PUBLISHED = (0.31314999283609557, 0.5610083763029411)


@pytest.mark.parametrize("kind", ["nocs", "axis_aligned", "oriented"])
def test_a_turn_about_the_vertical_axis_costs_nothing_where_it_cannot_be_seen(kind):
    size = np.array([0.5, 0.8, 0.3])
    a, b = at((0, 0, 1), TILTED, 0.3), at((0, 0, 1), TILTED * Rotation.from_euler("y", 90, degrees=True), 0.3)
    assert best_iou(kind, a, size, b, size, symmetric=True) == pytest.approx(1)
    assert best_iou(kind, a, size, b, size, symmetric=False) < 0.9


def test_many_poses_are_compared_at_once():
    poses = np.stack([at((x, 0, 0)) for x in (0, 0.5)])
    for iou in (axis_aligned_iou, oriented_iou):
        np.testing.assert_allclose(iou(poses, UNIT, at(), UNIT), [1, 1 / 3], atol=1e-9)


def test_a_kind_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="kind must be one of nocs, axis_aligned, oriented, got 'exact'"):
        best_iou("exact", at(), UNIT, at(), UNIT, symmetric=False)
