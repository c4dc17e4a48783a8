"""The contract of networks that compare a photo with a drawing and predict how the drawing's pose must change."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix, rotation_matrix_to_axis_angle
from torch import Tensor, nn

from kfit.core.arguments import check_arguments
from kfit.core.part import Part
from kfit.geometry.symmetry import Symmetry

# Below this the axis of a rotation between two directions is not defined.
_SMALLEST = 1e-6


class PoseUpdate(NamedTuple):
    """How N drawn poses must change, and how certain that is.

    Attributes:
        rotation: (N, 3) rotation vectors ω in radians in the axes of the camera (x right, y up, z towards the viewer):
            the new rotation is exp([ω]×) · R.
        shift: (N, 2) to be added to the shift, in half-widths of the picture (x right, y up).
        log_scale: (N,) to be added to the logarithm of the scale.
        log_error: (N, 4) logarithms of the expected absolute errors of the update: of the tilt of the object's
            vertical axis and the turn about it, both in radians, of the shift, and of the log scale.
        logit: (N,) log-odds that the drawn rotation is right, before the update.

    Example:
        >>> zeros = torch.zeros(2, 4)
        >>> still = PoseUpdate(zeros[:, :3], zeros[:, :2], zeros[:, 0], zeros, zeros[:, 0])
        >>> still.logit.sigmoid()  # of two poses, each as likely right as wrong
        tensor([0.5000, 0.5000])
    """

    rotation: Tensor
    shift: Tensor
    log_scale: Tensor
    log_error: Tensor
    logit: Tensor


class RefinerNetwork(Part, nn.Module, ABC):
    """Compares photos with drawings and predicts how the drawn poses must change.

    Rotations are updated in the axes of the camera. There a turn of the picture turns the update, a mirror mirrors it,
    no pose is singular, and the same motion of the picture is the same update at every azimuth and for every category.
    Updates of azimuth, elevation and roll would depend on the pose: straight from above azimuth and roll are one.

    Example:
        >>> class Still(RefinerNetwork):
        ...     def forward(self, observed, drawn):
        ...         zeros = observed.new_zeros(len(observed), 4)
        ...         return PoseUpdate(zeros[:, :3], zeros[:, :2], zeros[:, 0], zeros, zeros[:, 0])
        >>> Still()(torch.rand(2, 4, 8, 8), torch.rand(2, 4, 8, 8)).rotation.shape
        torch.Size([2, 3])
    """

    @abstractmethod
    def forward(self, observed: Tensor, drawn: Tensor) -> PoseUpdate:
        """Compare pictures (N, 4, S, S), RGB in [0, 1] on white and mask, row by row."""


def refiner_input(image: Tensor, mask: Tensor, weight: Tensor | None = None) -> Tensor:
    """Stack pictures (N, 3, S, S) and masks (N, 1, S, S) to a refiner's input (N, 4, S, S).

    Args:
        image: RGB in [0, 1] on white.
        mask: in [0, 1].
        weight: (N, 1, S, S), 0 where a pixel does not count: there the input is white and outside of the mask.

    Example:
        >>> refiner_input(torch.zeros(1, 3, 1, 2), torch.ones(1, 1, 1, 2), torch.tensor([[[[1.0, 0.0]]]]))[0, :, 0, 1]
        tensor([1., 1., 1., 0.])
    """
    if weight is not None:
        image, mask = torch.where(weight > 0, image, 1.0), torch.where(weight > 0, mask, 0.0)
    return torch.cat([image, mask], 1)


def updated_rotation(rotation: Tensor, update: Tensor) -> Tensor:
    """Return rotations (N, 3, 3) after updates ω (N, 3) in the axes of the camera: exp([ω]×) · R.

    Example:
        >>> quarter = torch.tensor([[0.0, 0.0, torch.pi / 2]])
        >>> (updated_rotation(torch.eye(3)[None], quarter)[0, :, 0] + 1).round()  # the x axis points up
        tensor([1., 2., 1.])
    """
    rotated: Tensor = axis_angle_to_rotation_matrix(update) @ rotation
    return rotated


def rotation_update(rotation: Tensor, target: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Return the update (N, 3) that takes rotations (N, 3, 3) to their targets, the inverse of `updated_rotation`.

    With the symmetry ``"y"`` it is the least rotation that takes the vertical axis u to its target u*, along u × u*.

    Raises:
        ValueError: for another symmetry than "none" and "y".

    Example:
        >>> from kfit.geometry import rotation_from_angles
        >>> turned = rotation_from_angles(torch.tensor([0.5]), torch.tensor([0.0]), torch.tensor([0.0]))
        >>> rotation_update(torch.eye(3)[None], turned)
        tensor([[0.0000, 0.5000, 0.0000]])
        >>> rotation_update(torch.eye(3)[None], turned, "y").norm()
        tensor(0.)
    """
    check_arguments(rotation_update, locals())
    if symmetry == "none":
        update: Tensor = rotation_matrix_to_axis_angle(target @ rotation.mT)
        return update
    up, wanted = rotation[:, :, 1], target[:, :, 1]
    axis = torch.linalg.cross(up, wanted)
    sine = axis.norm(dim=1, keepdim=True)
    angle = torch.atan2(sine, (up * wanted).sum(1, keepdim=True))
    least: Tensor = axis / sine.clamp_min(_SMALLEST) * angle
    return least
