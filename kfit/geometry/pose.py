"""Poses as angles and as rotation matrices, in the generator's y-up frame and in OpenCV's camera axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix
from torch import Tensor

from kfit.geometry.symmetry import Symmetry, check_symmetry, num_turns, turns_about_y

Angles = TypeVar("Angles", Tensor, "np.ndarray")


def rotation_from_angles(azimuth: Tensor, elevation: Tensor, roll: Tensor) -> Tensor:
    """Rotation that takes object axes (y up) to the generator's frame (x right, y up, z towards the viewer).

    R = Rz(roll) · Rx(elevation) · Ry(azimuth): azimuth turns the object about its own vertical axis, elevation tips
    its top towards the viewer, roll turns the finished picture anticlockwise.

    Args:
        azimuth, elevation, roll: (…) in radians; they broadcast.

    Returns:
        (…, 3, 3), differentiable everywhere.
    """
    azimuth, elevation, roll = torch.broadcast_tensors(azimuth, elevation, roll)
    zero = torch.zeros_like(azimuth)
    axes = (zero, zero, roll, elevation, zero, zero, zero, azimuth, zero)
    turns = axis_angle_to_rotation_matrix(torch.stack(axes, -1).unflatten(-1, (3, 3)))
    about_z, about_x, about_y = turns.unbind(-3)
    turned: Tensor = about_z @ about_x @ about_y
    return turned


def azimuth_from_released(azimuth: Angles) -> Angles:
    """Convert an azimuth of the released code (neural_object_fitting@7309348) to kfit's, which is about NOCS's axes.

    azimuth_kfit = −azimuth − π/2: the released code turns the other way, and its objects stand a quarter-turn away from
    NOCS's axes. Its eval.py takes that back: with half-turns ax, ay, az it reports the rotation Euler "yxz"
    (−ay − ½, ax + 1, −az) · 180°, which is `to_opencv` of `rotation_from_angles` (azimuth_kfit, ax · π, az · π).

    >>> azimuth_from_released(torch.tensor(0.0))  # the front, NOCS's +x, towards the viewer
    tensor(-1.5708)

    Args:
        azimuth: (…) in radians.

    Returns:
        (…) in radians.
    """
    return -azimuth - math.pi / 2


def rotation_of(values: Mapping[str, Tensor]) -> Tensor:
    """Rotations (N, 3, 3) of a fit's values: ``azimuth``, ``elevation`` and, where there is one, ``roll``."""
    azimuth = values["azimuth"]
    return rotation_from_angles(azimuth, values["elevation"], values.get("roll", torch.zeros_like(azimuth)))


def angles_from_rotation(rotation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Azimuth, elevation and roll of a y-up rotation: the inverse of `rotation_from_angles`.

    With a = azimuth, e = elevation, r = roll, the last row of R is (−cos e sin a, sin e, cos e cos a), and the first
    column of R · Ry(−a) is (cos r, sin r, 0). Taking roll from the latter keeps the three consistent even straight
    from above or below, where only azimuth ± roll is defined.

    Args:
        rotation: (…, 3, 3).

    Returns:
        Three (…) in radians: azimuth and roll in [−π, π], elevation in [−π/2, π/2].
    """
    horizontal = torch.hypot(rotation[..., 2, 0], rotation[..., 2, 2])
    elevation = torch.atan2(rotation[..., 2, 1], horizontal)
    azimuth = torch.atan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    sideways = rotation[..., :, 0] * azimuth.cos()[..., None] + rotation[..., :, 2] * azimuth.sin()[..., None]
    return azimuth, elevation, torch.atan2(sideways[..., 1], sideways[..., 0])


def to_opencv(rotation: Tensor) -> Tensor:
    """The y-up rotation (…, 3, 3) in OpenCV's camera axes (x right, y down, z forward): diag(1, −1, −1) · R."""
    return rotation * rotation.new_tensor([1.0, -1.0, -1.0])[:, None]


def from_opencv(rotation: Tensor) -> Tensor:
    """The OpenCV rotation (…, 3, 3) in the generator's y-up frame: diag(1, −1, −1) · R, its own inverse."""
    return to_opencv(rotation)


def rotation_error(a: Tensor, b: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Angle between two rotations of the same object, in radians.

    ``"none"``: with m = aᵀb, atan2(‖m − mᵀ‖ / √8, (tr m − 1) / 2), Frobenius norm: the sine and the cosine of the
    angle, which unlike the arc cosine alone keeps its digits near 0 and π. ``"y"``: angle between the vertical axes
    a·ŷ and b·ŷ, for objects that look the same turned about them. ``"y2"`` to ``"y12"``: the least angle to b turned by
    360° · k / K about its vertical axis.

    Args:
        a, b: (…, 3, 3) in the same frame; they broadcast.
        symmetry: of the object, see `kfit.geometry.Category`.

    Returns:
        (…) in [0, π].

    Raises:
        ValueError: for a symmetry of another name.
    """
    check_symmetry("symmetry", symmetry)
    if symmetry == "y":
        up_a, up_b = a[..., :, 1], b[..., :, 1]
        # The half angle's tangent is ‖u − v‖ / ‖u + v‖ (Kahan): sound near 0 and near π alike.
        return 2 * torch.atan2((up_a - up_b).norm(dim=-1), (up_a + up_b).norm(dim=-1))
    if symmetry != "none":
        turned = b[..., None, :, :] @ turns_about_y(num_turns(symmetry)).to(b)
        return rotation_error(a[..., None, :, :], turned).amin(-1)
    turn = a.mT @ b
    sine = (turn - turn.mT).flatten(-2).norm(dim=-1) / 8**0.5
    cosine = (turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    return torch.atan2(sine, cosine)
