"""The result of a registration."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from kornia.geometry.transform import remap, warp_affine3d
from torch import Tensor

from kfit.core import FitResult
from kfit.generators.motions import pixel_grid


@dataclass(frozen=True)
class Registration:
    """Maps from B moving pictures or volumes to B fixed ones; those of volumes have an axis D before H.

    Attributes:
        matrix: (B, 3, 3), from pixels (x, y) of the moving picture to pixels of the fixed one, centres at integers; for
            volumes (B, 4, 4) for voxels (x, y, z); None for non-rigid motions.
        displacement: (B, 2, H, W) in pixels, x right and y down, for volumes (B, 3, D, H, W) as (x, y, z): pixel p of
            the fixed picture corresponds to p + displacement(p) in the moving one.
        warped: (B, C, H, W), the moving pictures warped to the fixed ones, gain and offset included.
        weight: (B, 1, H, W) in [0, 1], coverage of each pixel of the fixed picture by the moving one.
        overlap: (B,), the fraction of the fixed picture's weight that is covered.
        energy: (B,) final ranking energy at full resolution; infinite below the least overlap.
        gain, offset: (B,), gain · moving + offset explains the fixed picture; 1 and 0 if they were not fitted.
        fits: the fits from coarse to fine, with the history of each.

    Example:
        >>> import torch, kfit
        >>> moving = torch.rand(1, 1, 6, 6, generator=torch.Generator().manual_seed(0))
        >>> moving = torch.nn.functional.interpolate(moving, (24, 24), mode="bicubic").clamp(0, 1)
        >>> found = kfit.register(moving, moving.roll(2, -1), "translation", light=False)
        >>> found.transform_points(torch.tensor([[[12.0, 12.0]]])).round()  # fixed to moving
        tensor([[[10., 12.]]])
        >>> found.warp(moving).shape
        torch.Size([1, 1, 24, 24])
    """

    matrix: Tensor | None
    displacement: Tensor = field(repr=False)
    warped: Tensor = field(repr=False)
    weight: Tensor = field(repr=False)
    overlap: Tensor
    energy: Tensor
    gain: Tensor
    offset: Tensor
    fits: tuple[FitResult, ...] = field(repr=False)

    def warp(self, picture: Tensor) -> Tensor:
        """Warp other pictures of the moving pictures' size, such as label maps, to the fixed ones; 0 outside.

        Args:
            picture: (B, C, H, W), or volumes (B, C, D, H, W).
        """
        if self.displacement.dim() == 5:
            assert self.matrix is not None  # all motions of volumes are matrices
            depth, height, width = self.displacement.shape[2:]
            moved: Tensor = warp_affine3d(picture.to(self.matrix), self.matrix[:, :3], (depth, height, width))
            return moved
        size = (self.displacement.shape[2], self.displacement.shape[3])
        places = pixel_grid(self.displacement, size) + self.displacement.movedim(1, -1)
        warped: Tensor = remap(picture.to(places), *places.unbind(-1), align_corners=True)
        return warped

    def transform_points(self, points: Tensor) -> Tensor:
        """Map points (B, K, 2) of the fixed pictures, (x, y) in pixels, to the moving ones; for volumes (B, K, 3).

        Displacements are linearly interpolated; outside of the picture the nearest pixel's is used.
        """
        sides = self.displacement.shape[2:]
        unit = 2 * points / points.new_tensor([side - 1 for side in sides[::-1]]) - 1
        grid = unit.view(len(unit), *[1] * (len(sides) - 1), *unit.shape[1:])
        found = torch.nn.functional.grid_sample(
            self.displacement, grid.to(self.displacement), padding_mode="border", align_corners=True
        )
        return points + found.flatten(2).mT.to(points)
