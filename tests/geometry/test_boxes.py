import pytest
import torch

from kfit.geometry import EDGES, box_corners, project, rotation_from_angles


def test_corners_lie_half_the_size_from_the_centre() -> None:
    corners = box_corners(torch.eye(3), torch.tensor([1.0, 2, 3]), torch.tensor([0.2, 0.4, 0.6]))
    assert corners.shape == (8, 3)
    torch.testing.assert_close(corners[0], torch.tensor([0.9, 1.8, 2.7]))
    torch.testing.assert_close(corners[1], torch.tensor([1.1, 1.8, 2.7]))
    torch.testing.assert_close(corners[6], torch.tensor([0.9, 2.2, 3.3]))


def test_twelve_edges_have_the_boxs_lengths_however_it_is_turned() -> None:
    size = torch.tensor([0.2, 0.4, 0.6])
    rotation = rotation_from_angles(torch.tensor(0.4), torch.tensor(0.5), torch.tensor(0.6))
    corners = box_corners(rotation, torch.zeros(3), size)
    lengths = torch.stack([(corners[i] - corners[j]).norm() for i, j in EDGES])
    torch.testing.assert_close(lengths.sort().values, size.repeat_interleave(4))


def test_a_quarter_turn_about_y_swaps_width_and_depth() -> None:
    rotation = rotation_from_angles(torch.tensor(torch.pi / 2), torch.tensor(0.0), torch.tensor(0.0))
    corners = box_corners(rotation, torch.zeros(3), torch.tensor([0.2, 0.4, 0.6]))
    torch.testing.assert_close(corners.amax(0), torch.tensor([0.3, 0.2, 0.1]))


def test_points_project_by_the_intrinsics() -> None:
    intrinsics = torch.tensor([[100.0, 0, 31.5], [0, 120, 23.5], [0, 0, 1]])
    pixels = project(torch.tensor([[0.0, 0, 2], [0.5, -0.5, 2]]), intrinsics)
    torch.testing.assert_close(pixels, torch.tensor([[31.5, 23.5], [56.5, -6.5]]))
    assert project(torch.ones(4, 8, 3), intrinsics.expand(4, 3, 3)).shape == (4, 8, 2)


def test_points_behind_the_camera_are_refused() -> None:
    with pytest.raises(ValueError, match="in front of the camera, got a depth of -1 m"):
        project(torch.tensor([[0.0, 0, -1]]), torch.eye(3))
