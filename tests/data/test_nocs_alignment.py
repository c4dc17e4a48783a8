import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kfit.data import align


def pairs(count=300, noise=0.0):
    rng = np.random.default_rng(0)
    pose = np.eye(4)
    pose[:3, :3] = 0.25 * Rotation.from_rotvec([0.3, -2, 0.5]).as_matrix()
    pose[:3, 3] = [0.1, -0.2, 1.1]
    coordinates = rng.uniform(-0.4, 0.4, (count, 3))
    points = coordinates @ pose[:3, :3].T + pose[:3, 3] + noise * rng.normal(size=(count, 3))
    return coordinates, points, pose


def test_exact_pairs_give_the_similarity():
    coordinates, points, pose = pairs()
    np.testing.assert_allclose(align(coordinates, points), pose, atol=1e-9)


def test_wrong_pairs_do_not_matter():
    coordinates, points, pose = pairs(noise=1e-3)
    points[::3] += np.random.default_rng(1).uniform(-0.5, 0.5, points[::3].shape)
    found = align(coordinates, points)
    np.testing.assert_allclose(found, pose, atol=3e-3)
    np.testing.assert_array_equal(found, align(coordinates, points))


def test_a_mirrored_object_is_not_mirrored_back():
    coordinates, points, _ = pairs()
    coordinates[:, 2] *= -1
    with pytest.raises(ValueError, match="no similarity brings a tenth of 300 pairs within 1e-05 m"):
        align(coordinates, points, tolerance=1e-5)


def test_what_cannot_be_aligned_is_refused():
    with pytest.raises(ValueError, match="at least 16 pairs, got 5"):
        align(np.zeros((5, 3)), np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r"must both be \(M, 3\), got \(20, 3\) and \(20, 2\)"):
        align(np.zeros((20, 3)), np.zeros((20, 2)))
