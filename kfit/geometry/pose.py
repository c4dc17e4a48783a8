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
    """Return the rotation from object axes (y up) to the generator's frame (x right, y up, z towards the viewer).

    R = Rz(roll) · Rx(elevation) · Ry(azimuth): azimuth rotates the object about its own vertical axis, elevation tilts
    its top towards the viewer, roll rotates the picture anticlockwise.

    Args:
        azimuth, elevation, roll: (…) in radians; they broadcast.

    Returns:
        (…, 3, 3), differentiable everywhere.

    Example:
        >>> import math, torch
        >>> from kfit.geometry import rotation_from_angles
        >>> quarter = torch.tensor(math.pi / 2)
        >>> rotation_from_angles(quarter, 0 * quarter, 0 * quarter)[:, 0].round() + 0  # object x: away from the viewer
        tensor([ 0.,  0., -1.])
    """
    azimuth, elevation, roll = torch.broadcast_tensors(azimuth, elevation, roll)
    zero = torch.zeros_like(azimuth)
    axes = (zero, zero, roll, elevation, zero, zero, zero, azimuth, zero)
    turns = axis_angle_to_rotation_matrix(torch.stack(axes, -1).unflatten(-1, (3, 3)))
    about_z, about_x, about_y = turns.unbind(-3)
    rotation: Tensor = about_z @ about_x @ about_y
    return rotation


def azimuth_from_released(azimuth: Angles) -> Angles:
    """Convert an azimuth of the released code (neural_object_fitting@7309348) to kfit's, which is about NOCS's axes.

    azimuth_kfit = −azimuth − π/2: the released code rotates in the other direction, and its objects are rotated by 90°
    relative to NOCS's axes. Its eval.py reverts that: with half-turns ax, ay, az it reports the rotation Euler "yxz"
    (−ay − ½, ax + 1, −az) · 180°, which is `to_opencv` of `rotation_from_angles` (azimuth_kfit, ax · π, az · π).

    Args:
        azimuth: (…) in radians.

    Returns:
        (…) in radians.

    Example:
        >>> import torch
        >>> from kfit.geometry import azimuth_from_released
        >>> azimuth_from_released(torch.tensor(0.0))  # the front, NOCS's +x, towards the viewer
        tensor(-1.5708)
    """
    return -azimuth - math.pi / 2


def rotation_of(values: Mapping[str, Tensor]) -> Tensor:
    """Return rotations (N, 3, 3) of a fit's values: ``azimuth``, ``elevation`` and, if present, ``roll``."""
    azimuth = values["azimuth"]
    return rotation_from_angles(azimuth, values["elevation"], values.get("roll", torch.zeros_like(azimuth)))


def angles_from_rotation(rotation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return azimuth, elevation and roll of a y-up rotation: the inverse of `rotation_from_angles`.

    With a = azimuth, e = elevation, r = roll, the last row of R is (−cos e sin a, sin e, cos e cos a), and the first
    column of R · Ry(−a) is (cos r, sin r, 0). Roll from the latter is consistent even for views straight from above or
    below, where only azimuth ± roll is defined.

    Args:
        rotation: (…, 3, 3).

    Returns:
        Three (…) in radians: azimuth and roll in [−π, π], elevation in [−π/2, π/2].

    Example:
        >>> import torch
        >>> from kfit.geometry import angles_from_rotation, rotation_from_angles
        >>> angles_from_rotation(rotation_from_angles(*torch.tensor([0.3, 0.2, 0.1])))
        (tensor(0.3000), tensor(0.2000), tensor(0.1000))
    """
    horizontal = torch.hypot(rotation[..., 2, 0], rotation[..., 2, 2])
    elevation = torch.atan2(rotation[..., 2, 1], horizontal)
    azimuth = torch.atan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    sideways = rotation[..., :, 0] * azimuth.cos()[..., None] + rotation[..., :, 2] * azimuth.sin()[..., None]
    return azimuth, elevation, torch.atan2(sideways[..., 1], sideways[..., 0])


def to_opencv(rotation: Tensor) -> Tensor:
    """Convert a y-up rotation (…, 3, 3) to OpenCV's camera axes (x right, y down, z forward): diag(1, −1, −1) · R.

    Example:
        >>> import torch
        >>> from kfit.geometry import to_opencv
        >>> to_opencv(torch.eye(3)).diagonal()
        tensor([ 1., -1., -1.])
    """
    return rotation * rotation.new_tensor([1.0, -1.0, -1.0])[:, None]


def from_opencv(rotation: Tensor) -> Tensor:
    """Convert an OpenCV rotation (…, 3, 3) to the generator's y-up frame: diag(1, −1, −1) · R, an involution.

    Example:
        >>> import torch
        >>> from kfit.geometry import from_opencv, to_opencv
        >>> bool((from_opencv(to_opencv(torch.eye(3))) == torch.eye(3)).all())
        True
    """
    return to_opencv(rotation)


def rotation_error(a: Tensor, b: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Return the angle between two rotations of the same object, in radians.

    ``"none"``: with m = aᵀb, atan2(‖m − mᵀ‖ / √8, (tr m − 1) / 2), Frobenius norm: the sine and the cosine of the
    angle, which unlike the arc cosine alone is precise near 0 and π. ``"y"``: angle between the vertical axes
    a·ŷ and b·ŷ, for objects with rotational symmetry about them. ``"y2"`` to ``"y12"``: the least angle to b turned by
    360° · k / K about its vertical axis.

    Args:
        a, b: (…, 3, 3) in the same frame; they broadcast.
        symmetry: symmetry of the object, see `kfit.geometry.Category`.

    Returns:
        (…) in [0, π].

    Raises:
        ValueError: if the symmetry is unknown.

    Example:
        >>> import torch
        >>> from kfit.geometry import rotation_error, rotation_from_angles
        >>> turned = rotation_from_angles(*torch.tensor([0.5, 0.0, 0.0]))
        >>> rotation_error(torch.eye(3), turned), rotation_error(torch.eye(3), turned, "y")
        (tensor(0.5000), tensor(0.))
    """
    check_symmetry("symmetry", symmetry)
    if symmetry == "y":
        up_a, up_b = a[..., :, 1], b[..., :, 1]
        # The half angle's tangent is ‖u − v‖ / ‖u + v‖ (Kahan), which is precise near 0 and near π.
        return 2 * torch.atan2((up_a - up_b).norm(dim=-1), (up_a + up_b).norm(dim=-1))
    if symmetry != "none":
        rotated = b[..., None, :, :] @ turns_about_y(num_turns(symmetry)).to(b)
        return rotation_error(a[..., None, :, :], rotated).amin(-1)
    turn = a.mT @ b
    sine = (turn - turn.mT).flatten(-2).norm(dim=-1) / 8**0.5
    cosine = (turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    return torch.atan2(sine, cosine)
