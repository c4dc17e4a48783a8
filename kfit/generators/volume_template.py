"""A fixed volume that is moved: registration of volumes as a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import torch
from kornia.geometry.linalg import transform_points
from kornia.geometry.transform import warp_affine3d
from torch import Tensor

from kfit.core import Generator, Observation, Rendering
from kfit.core.arguments import check_arguments
from kfit.core.check import check_float, check_shape
from kfit.generators.motions import pixel_grid
from kfit.generators.template import LEAST_COVER, LIGHT
from kfit.generators.volume_motions import VOLUME_MOTIONS, volume_matrix_of

VolumeMotion = Literal["translation", "euclidean", "similarity", "affine"]


class VolumeTemplate(Generator):
    """Draw a fixed volume, moved: the counterpart of `kfit.generators.Template` for volumes.

    A point p of the template, in voxels from the centre, x along the width, y along the height, z along the depth,
    moves to

    - translation: p + shift;
    - euclidean: rotation · p + shift;
    - similarity: scale · rotation · p + shift;
    - affine: linear · p + shift.

    ``shift`` is in half-sides, ``rotation`` in SO(3). Voxels are cubes. The warp is trilinear
    (`kornia.geometry.transform.warp_affine3d`). Mask and weight of the rendering are the template's coverage.

    Args:
        volume: (B, C, D, H, W) in [0, 1], one template for all problems or one for each.
        motion: "translation", "euclidean", "similarity" or "affine".
        fill: brightness outside of the template, which has weight 0.
        mask: (B, 1, D, H, W) in [0, 1], where the template is known; everywhere by default.
        light: whether to fit ``gain`` (above 0) and ``bias`` of the template's brightness, gain · volume + bias.

    Raises:
        TypeError, ValueError: if the volume holds integers or has another shape, the motion is unknown or, in a fit,
            the number of problems differs from that of templates.

    Example:
        >>> import torch
        >>> from kfit.generators import VolumeTemplate
        >>> template = VolumeTemplate(torch.rand(1, 1, 8, 16, 16), "translation")
        >>> template(shift=torch.tensor([[1.0, 0.0, 0.0]])).weight.mean()  # moved by half of the width
        tensor(0.5000)
    """

    voxels: Tensor

    def __init__(
        self,
        volume: Tensor,
        motion: VolumeMotion = "euclidean",
        fill: float = 1.0,
        mask: Tensor | None = None,
        light: bool = False,
    ) -> None:
        super().__init__()
        check_shape("volume", volume, ("B", "C", "D", "H", "W"))
        check_float("volume", volume)
        check_arguments(VolumeTemplate, locals())
        mask = torch.ones_like(volume[:, :1]) if mask is None else mask
        check_shape("mask", mask, (len(volume), 1, *volume.shape[2:]))
        self.motion, self.fill, self.size = motion, fill, tuple(volume.shape[2:])
        self.moving = dict(VOLUME_MOTIONS[motion])
        self.variables = {**self.moving, **(LIGHT if light else {})}
        volume, mask = volume.detach(), mask.detach()
        self.register_buffer("voxels", torch.cat([volume * mask, mask], 1))

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        count = observation.num_problems
        if len(self.voxels) == 1:
            return {}
        if len(self.voxels) != count:
            raise ValueError(f"VolumeTemplate: {len(self.voxels)} volumes cannot be fitted to {count} problems")
        return {"template": torch.arange(count, device=self.voxels.device)}

    def forward(self, **values: Tensor) -> Rendering:
        template = values.get("template")
        depth, height, width = self.size
        # Without autocast: positions in bfloat16 are off by voxels.
        with torch.autocast(self.voxels.device.type, enabled=False):
            matrix = self.matrix(**{name: value for name, value in values.items() if name in self.moving})
            # Kornia's inverse fails for all rows if one is singular; such a row is moved out of the frame.
            away = torch.eye(4).to(matrix)
            away[0, 3] = 4 * width
            usable = torch.linalg.det(matrix.detach()[:, :3, :3])
            usable = (usable > 1e-6) & (usable < 1e6) & matrix.detach().isfinite().all((1, 2))
            matrix = torch.where(usable[:, None, None], matrix, away)
            voxels = self.voxels.expand(len(matrix), -1, -1, -1, -1) if template is None else self.voxels[template]
            warped = warp_affine3d(voxels, matrix[:, :3].to(voxels), (depth, height, width), align_corners=True)
        cover = warped[:, -1:]
        covered = cover > LEAST_COVER
        image = warped[:, :-1] / torch.where(covered, cover, 1)
        if "gain" in values:
            gain, bias = (values[name].view(-1, 1, 1, 1, 1) for name in ("gain", "bias"))
            image = gain * image + bias
        mask = torch.where(covered, cover, 0)
        return Rendering(image=torch.where(covered, image, self.fill), mask=mask, weight=mask)

    def places(self, **values: Tensor) -> Tensor:
        """Return the positions (N, D, H, W, 3), as (x, y, z) in template voxels, that the drawing samples.

        Args:
            values: values of the motion's variables, (N, \\*shape) each.
        """
        inverse = torch.linalg.inv(self.matrix(**values))
        points = pixel_grid(inverse, self.size).view(1, -1, 3)
        read: Tensor = transform_points(inverse, points.expand(len(inverse), -1, -1))
        return read.view(-1, *self.size, 3)

    def matrix(self, **values: Tensor) -> Tensor:
        """Return matrices (N, 4, 4) from the template's voxels (x, y, z) to the drawing's, voxel centres at integers.

        Args:
            values: values of the motion's variables, (N, \\*shape) each.
        """
        return volume_matrix_of(values, self.size)
