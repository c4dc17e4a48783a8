"""What a registration found."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from kornia.geometry.transform import remap
from torch import Tensor

from kfit.core import FitResult
from kfit.generators.motions import pixel_grid


@dataclass(frozen=True)
class Registration:
    """What takes B moving pictures to B fixed ones.

    Attributes:
        matrix: (B, 3, 3), takes pixels (x, y) of the moving picture to pixels of the fixed one, centres at whole
            numbers; None for motions that bend.
        displacement: (B, 2, H, W) in pixels, x right and y down: the fixed picture's pixel p shows what the moving one
            has at p + displacement(p).
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
            picture: (B, C, H, W).
        """
        size = (self.displacement.shape[2], self.displacement.shape[3])
        places = pixel_grid(self.displacement, size) + self.displacement.movedim(1, -1)
        warped: Tensor = remap(picture.to(places), *places.unbind(-1), align_corners=True)
        return warped

    def transform_points(self, points: Tensor) -> Tensor:
        """Take points (B, K, 2) of the fixed pictures, (x, y) in pixels, to the moving ones.

        Between pixels the displacement is bilinear, outside the picture that of the nearest pixel.
        """
        height, width = self.displacement.shape[2:]
        unit = 2 * points / points.new_tensor([width - 1, height - 1]) - 1
        found = torch.nn.functional.grid_sample(
            self.displacement, unit[:, None].to(self.displacement), padding_mode="border", align_corners=True
        )
        return points + found[:, :, 0].mT.to(points)
