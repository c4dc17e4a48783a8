"""Oriented boxes in front of a camera."""

from __future__ import annotations

import torch
from kornia.geometry.camera import project_points
from torch import Tensor

# Corner i lies at the far side of axis k where bit k of i is set; an edge joins two corners that differ in one bit.
EDGES: tuple[tuple[int, int], ...] = tuple((i, i | 1 << k) for k in range(3) for i in range(8) if not i & 1 << k)


def box_corners(rotation: Tensor, translation: Tensor, size: Tensor) -> Tensor:
    """Return the eight corners x = R (± size / 2) + t of an oriented box.

    Args:
        rotation: (…, 3, 3) object to camera.
        translation: (…, 3) of the box's centre in metres.
        size: (…, 3) extents along the object's axes in metres.

    Returns:
        (…, 8, 3); corner i is at +size / 2 along axis k where bit k of i is set.

    Example:
        >>> import torch
        >>> from kfit.geometry import box_corners
        >>> box_corners(torch.eye(3), torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.2, 0.4, 0.6]))[:2]
        tensor([[-0.1000, -0.2000,  0.7000],
                [ 0.1000, -0.2000,  0.7000]])
    """
    signs = torch.tensor([[1.0 if i >> k & 1 else -1.0 for k in range(3)] for i in range(8)]).to(size)
    return (signs * size[..., None, :] / 2) @ rotation.mT + translation[..., None, :]


def project(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Project points (…, M, 3) by a camera with intrinsics (…, 3, 3), OpenCV axes, to pixels (…, M, 2).

    Raises:
        ValueError: if a point lies in or behind the camera's plane, where it has no pixel.

    Example:
        >>> import torch
        >>> from kfit.geometry import intrinsics_from_fov, project
        >>> project(torch.tensor([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]]), intrinsics_from_fov(640, 480))
        tensor([[319.5000, 239.5000],
                [374.9256, 239.5000]])
    """
    if bool((points[..., 2] <= 0).any()):
        nearest = float(points[..., 2].min())
        raise ValueError(
            f"all points must lie in front of the camera, got a depth of {nearest:g} m; are the intrinsics right?"
        )
    pixels: Tensor = project_points(points, intrinsics.to(points)[..., None, :, :])
    return pixels
