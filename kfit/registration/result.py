"""What a registration found."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from kornia.geometry.transform import remap, warp_affine3d
from torch import Tensor

from kfit.core import FitResult
from kfit.generators.motions import pixel_grid


@dataclass(frozen=True)
class Registration:
    """What takes B moving pictures or volumes to B fixed ones; those of volumes have an axis D before H.

    Attributes:
        matrix: (B, 3, 3), takes pixels (x, y) of the moving picture to pixels of the fixed one, centres at whole
            numbers; of volumes (B, 4, 4) for voxels (x, y, z); None for motions that bend.
        displacement: (B, 2, H, W) in pixels, x right and y down, of volumes (B, 3, D, H, W) as (x, y, z): the fixed
            picture's pixel p shows what the moving one has at p + displacement(p).
        warped: (B, C, H, W), the moving pictures as the fit drew them on the fixed ones, gain and offset included.
        weight: (B, 1, H, W) in [0, 1], what the moving picture covers of each pixel of the fixed one.
        overlap: (B,), the share of the fixed picture's weight that it covers.
        energy: (B,) at the end, of the whole resolution, as the last fit ranked it; infinite below the least overlap.
        gain, offset: (B,), gain · moving + offset explains the fixed picture; 1 and 0 where they were not fitted.
        fits: the fits from coarse to fine, with the history of each.
    """

    matrix: Tensor | None
    displacement: Tensor
    warped: Tensor
    weight: Tensor
    overlap: Tensor
    energy: Tensor
    gain: Tensor
    offset: Tensor
    fits: tuple[FitResult, ...]

    def warp(self, picture: Tensor) -> Tensor:
        """Take other pictures of the moving pictures' size, such as label maps, to the fixed ones; 0 outside.

        Args:
            picture: (B, C, H, W), or volumes (B, C, D, H, W).
        """
        if self.displacement.dim() == 5:
            assert self.matrix is not None  # no motion of volumes bends
            depth, height, width = self.displacement.shape[2:]
            moved: Tensor = warp_affine3d(picture.to(self.matrix), self.matrix[:, :3], (depth, height, width))
            return moved
        size = (self.displacement.shape[2], self.displacement.shape[3])
        places = pixel_grid(self.displacement, size) + self.displacement.movedim(1, -1)
        warped: Tensor = remap(picture.to(places), *places.unbind(-1), align_corners=True)
        return warped

    def transform_points(self, points: Tensor) -> Tensor:
        """Take points (B, K, 2) of the fixed pictures, (x, y) in pixels, to the moving ones; of volumes (B, K, 3).

        Between pixels the displacement is linear, outside the picture that of the nearest pixel.
        """
        sides = self.displacement.shape[2:]
        unit = 2 * points / points.new_tensor([side - 1 for side in sides[::-1]]) - 1
        grid = unit.view(len(unit), *[1] * (len(sides) - 1), *unit.shape[1:])
        found = torch.nn.functional.grid_sample(
            self.displacement, grid.to(self.displacement), padding_mode="border", align_corners=True
        )
        return points + found.flatten(2).mT.to(points)
