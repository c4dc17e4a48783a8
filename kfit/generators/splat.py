"""Points evenly distributed over a textured surface, and their soft rendering as splats."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Rendering
from kfit.core.check import check_count, check_shape

# Depth difference, in box diagonals, at which the weights of surfaces differ by a factor of e.
DEPTH_SOFTNESS = 0.0125
# Points outside of the picture go to this border, which is cut off.
PAD = 3


class SurfacePoints(nn.Module):
    """P points evenly distributed over a textured mesh, with normals, colours and the area that each represents.

    Args:
        owner: name in errors.
        vertices: (V, 3).
        faces: (F, 3) vertex numbers.
        uv: (V, 2) column and row in the texture, from its upper left corner, in [0, 1].
        texture: (Ht, Wt, 3) RGB, uint8 or floating point in [0, 1].
        num_points: P.

    Attributes:
        share: area of the surface that a point represents, in squared units of the vertices.

    Raises:
        ValueError: if an array has another shape, or the surface has no area.
    """

    points: Tensor
    normals: Tensor
    colors: Tensor

    def __init__(self, owner: str, vertices: Any, faces: Any, uv: Any, texture: Any, num_points: int) -> None:
        super().__init__()
        check_count(f"{owner}: num_points", num_points, 1, 10**7)
        vertices, uv = (torch.as_tensor(array, dtype=torch.float32) for array in (vertices, uv))
        faces, texture = torch.as_tensor(faces).long(), torch.as_tensor(texture)
        check_shape(f"{owner}: vertices", vertices, ("V", 3))
        check_shape(f"{owner}: faces", faces, ("F", 3))
        check_shape(f"{owner}: uv", uv, (vertices.shape[0], 2))
        check_shape(f"{owner}: texture", texture, ("Ht", "Wt", 3))
        texture = texture.float() / 255 if texture.dtype == torch.uint8 else texture.float()
        corners = vertices[faces]
        spans = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = spans.norm(dim=1) / 2
        if not float(areas.sum()) > 0:
            raise ValueError(f"{owner}: the faces must span an area, got none")
        face, shares = _even_points(areas, num_points)
        self.register_buffer("points", (shares[..., None] * corners[face]).sum(1))
        self.register_buffer("normals", F.normalize(spans[face], dim=1))
        self.register_buffer("colors", _look_up(texture, (shares[..., None] * uv[faces[face]]).sum(1)))
        self.share = float(areas.sum()) / num_points

    def splat(
        self, column: Tensor, row: Tensor, depth: Tensor, area: Tensor, size: tuple[int, int], softness: float
    ) -> Rendering:
        """Draw N pictures of the points.

        Args:
            column, row: (N, P) positions in pixels.
            depth: (N, P).
            area: (N, P) in pixels that each point's part of the surface covers as seen from the camera.
            size: (H, W).
            softness: depth difference at which weights differ by a factor of e.
        """
        rows, height, width = depth.shape[0], size[0] + 2 * PAD, size[1] + 2 * PAD
        front = area * torch.exp(-depth / softness)
        # One kernel sums areas, weights, depths and colours.
        carried = torch.cat([torch.stack([area, front, front * depth], -1), front[..., None] * self.colors], -1)
        left, across = _kernel(column, size[1])
        top, down = _kernel(row, size[0])
        weights = (down[..., :, None] * across[..., None, :]).flatten(2)
        steps = torch.arange(3, device=depth.device)
        places = ((top[..., None] + steps)[..., :, None] * width + (left[..., None] + steps)[..., None, :]).flatten(2)
        places = places + height * width * torch.arange(rows, device=depth.device)[:, None, None]
        sums = carried.new_zeros(rows * height * width, 6)
        sums = sums.index_add(0, places.flatten(), (weights[..., None] * carried[:, :, None]).flatten(0, 2))
        sums = sums.view(rows, height, width, 6)[:, PAD:-PAD, PAD:-PAD].movedim(-1, 1)
        mask = 1 - torch.exp(-math.log(2) * sums[:, :1] ** 3)
        means = sums[:, 2:] / sums[:, 1:2].clamp_min(1e-30)
        return Rendering(1 + mask * (means[:, 1:] - 1), mask, means[:, :1])


def _kernel(place: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Return the first of three pixels (padded picture) that each point touches, and the B-spline weights (…, 3)."""
    nearest = place.detach().round().nan_to_num().clamp(-2, size + 1)
    t = (place - nearest).clamp(-0.5, 0.5)
    weights = torch.stack([(0.5 - t).square() / 2, 0.75 - t.square(), (0.5 + t).square() / 2], -1)
    return nearest.long() - 1 + PAD, weights


def _even_points(areas: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return faces (P,) and barycentric coordinates (P, 3) of points evenly distributed over a surface."""
    ends = areas.double().cumsum(0)
    number = torch.arange(count, dtype=torch.float64)
    face = torch.searchsorted(ends, (number + 0.5) / count * ends[-1]).clamp_max(len(areas) - 1)
    # Roberts' R2 sequence: multiples of the plastic number's inverse powers cover the unit square evenly.
    u, v = ((0.5 + step * number) % 1 for step in (0.7548776662466927, 0.5698402909980532))
    root = u.sqrt()
    return face, torch.stack([1 - root, root * (1 - v), root * v], 1).float()


def _look_up(texture: Tensor, uv: Tensor) -> Tensor:
    """Return bilinear colours (P, 3) at texture coordinates (P, 2)."""
    picture = texture.permute(2, 0, 1)[None]
    found = F.grid_sample(picture, 2 * uv[None, None] - 1, padding_mode="border", align_corners=False)
    return found[0, :, 0].T.contiguous()
