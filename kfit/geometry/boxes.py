"""Oriented boxes in front of a camera."""

from __future__ import annotations

import torch
from kornia.geometry.camera import project_points
from torch import Tensor

# Corner i lies at the far side of axis k where bit k of i is set; an edge joins two corners that differ in one bit.
EDGES: tuple[tuple[int, int], ...] = tuple((i, i | 1 << k) for k in range(3) for i in range(8) if not i & 1 << k)


def box_corners(rotation: Tensor, translation: Tensor, size: Tensor) -> Tensor:
    """The eight corners x = R (± size / 2) + t of an oriented box.

    Args:
        rotation: (…, 3, 3) object to camera.
        translation: (…, 3) of the box's centre in metres.
        size: (…, 3) extents along the object's axes in metres.

    Returns:
        (…, 8, 3); corner i is at +size / 2 along axis k where bit k of i is set.
    """
    signs = torch.tensor([[1.0 if i >> k & 1 else -1.0 for k in range(3)] for i in range(8)]).to(size)
    return (signs * size[..., None, :] / 2) @ rotation.mT + translation[..., None, :]


def project(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Pixels (…, M, 2) of points (…, M, 3) in front of a camera with intrinsics (…, 3, 3), OpenCV axes.

    Raises:
        ValueError: if a point lies in or behind the camera's plane, where no pixel shows it.
    """
    if bool((points[..., 2] <= 0).any()):
        nearest = float(points[..., 2].min())
        raise ValueError(
            f"all points must lie in front of the camera, got a depth of {nearest:g} m; are the intrinsics right?"
        )
    pixels: Tensor = project_points(points, intrinsics.to(points)[..., None, :, :])
    return pixels
