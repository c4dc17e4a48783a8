"""A known mesh, drawn so that a pose can be descended on."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.core import Angle, Generator, Positive, Rendering, Variable
from kfit.core.check import check_count, check_range, check_shape
from kfit.geometry import UNIT_FRACTION, focal_by_distance, rotation_from_angles

# Surfaces this far apart, in box diagonals, outweigh one another by e.
DEPTH_SOFTNESS = 0.0125
# Points beyond the picture go here, outside of what is cut out.
PAD = 3


class MeshRenderer(Generator):
    """Draws RGB, mask and depth of a known textured mesh, softly: for fitting the pose of an object with a CAD model.

    P points even over the surface are splat by the quadratic B-spline k (3 × 3 pixels, its sum 1). n = Σ_i a_i k_i
    counts the layers of surface, a_i being the area in pixels that point i's share of the surface covers as seen from
    the camera; mask = 1 − exp(−ln 2 · n³), which is 1/2 at the edge of a closed surface; colour and depth are means
    weighed by a_i k_i exp(−depth_i / 0.0125), so that the nearest surface wins, softly. (Splats as in Yifan et al.
    2019, "Differentiable surface splatting"; soft order in depth as in Liu et al. 2019, "Soft rasterizer".)

    Gradients are those of the picture as it is drawn, occlusion included, and continuous. They reach a pixel only from
    points within 1.5 pixels: where drawing and target do not overlap nothing pulls, so start near, or coarse to fine.
    Against an exact rasterizer at 64 × 64, outlines are 2 pixels wide instead of 1, a near surface spreads a pixel over
    what it hides, and a surface of one layer only, such as a sheet, draws half a mask. The texture is drawn as it is,
    without light or shadow. Mesh, texture and camera get no gradients.

    Variables: ``azimuth``, ``elevation`` and ``roll`` (radians), ``shift`` (2,) in half-widths (x right, y up) and
    ``scale`` (above 0), as those of `SimilarityWarp` around a generator of azimuth and elevation: shift and scale act
    on the finished projection.

    Args:
        vertices: (V, 3) in the object's frame, y up; centred at its box's centre, with its diagonal as unit.
        faces: (F, 3) vertex numbers.
        uv: (V, 2) column and row in the texture, from its upper left corner, in [0, 1].
        texture: (Ht, Wt, 3) RGB, uint8 or floating point in [0, 1].
        num_points: P; some 4 for each pixel that the object covers leave few holes.
        image_size: side S of the picture.
        distance: of the camera from the object's centre, in diagonals.
        unit_fraction: share of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Raises:
        ValueError: for arrays of other shapes, a surface without area, and a camera within the object.
    """

    points: Tensor
    normals: Tensor
    colors: Tensor

    def __init__(
        self,
        vertices: Any,
        faces: Any,
        uv: Any,
        texture: Any,
        num_points: int = 8192,
        image_size: int = 64,
        distance: float = 4.0,
        unit_fraction: float = UNIT_FRACTION,
    ) -> None:
        super().__init__()
        check_count("MeshRenderer: num_points", num_points, 1, 10**7)
        check_count("MeshRenderer: image_size", image_size, 1, 4096)
        check_range("MeshRenderer: unit_fraction", unit_fraction, 0.1, 10.0)
        check_range("MeshRenderer: distance", distance, 1, 1e6)
        self.variables = {
            "azimuth": Variable((), Angle()),
            "elevation": Variable((), Angle()),
            "roll": Variable((), Angle()),
            "shift": Variable((2,)),
            "scale": Variable((), Positive()),
        }
        vertices, uv = (torch.as_tensor(array, dtype=torch.float32) for array in (vertices, uv))
        faces, texture = torch.as_tensor(faces).long(), torch.as_tensor(texture)
        check_shape("MeshRenderer: vertices", vertices, ("V", 3))
        check_shape("MeshRenderer: faces", faces, ("F", 3))
        check_shape("MeshRenderer: uv", uv, (vertices.shape[0], 2))
        check_shape("MeshRenderer: texture", texture, ("Ht", "Wt", 3))
        texture = texture.float() / 255 if texture.dtype == torch.uint8 else texture.float()
        corners = vertices[faces]
        spans = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = spans.norm(dim=1) / 2
        if not float(areas.sum()) > 0:
            raise ValueError("MeshRenderer: the faces must span an area, got none")
        face, shares = _even_points(areas, num_points)
        self.register_buffer("points", (shares[..., None] * corners[face]).sum(1))
        self.register_buffer("normals", F.normalize(spans[face], dim=1))
        self.register_buffer("colors", _look_up(texture, (shares[..., None] * uv[faces[face]]).sum(1)))
        self.image_size, self.distance = image_size, distance
        # Pixels that a diagonal spans at the centre.
        self.unit = image_size * float(focal_by_distance(torch.tensor(distance), unit_fraction)) / distance
        self.share = float(areas.sum()) / num_points

    def forward(self, **values: Tensor) -> Rendering:
        with torch.autocast(self.points.device.type, enabled=False):
            rotation = rotation_from_angles(values["azimuth"], values["elevation"], values["roll"])
            placed = self.points @ rotation.mT
            x, y, z = placed.unbind(-1)
            sight = F.normalize(placed.new_tensor([0.0, 0.0, self.distance]) - placed, dim=-1)
            facing = ((self.normals @ rotation.mT) * sight).sum(-1).abs()
            near = self.unit * values["scale"][:, None] * self.distance / (self.distance - z)
            move = values["shift"] * self.image_size / 2
            centre = (self.image_size - 1) / 2
            column, row = centre + near * x + move[:, :1], centre - near * y - move[:, 1:]
            return self._splat(column, row, -z, facing * self.share * near.square())

    def _splat(self, column: Tensor, row: Tensor, depth: Tensor, area: Tensor) -> Rendering:
        rows, side = depth.shape[0], self.image_size + 2 * PAD
        front = area * torch.exp(-depth / DEPTH_SOFTNESS)
        # By the same kernel are summed: areas, weights, depths and colours.
        carried = torch.cat([torch.stack([area, front, front * depth], -1), front[..., None] * self.colors], -1)
        left, across = _kernel(column, self.image_size)
        top, down = _kernel(row, self.image_size)
        weights = (down[..., :, None] * across[..., None, :]).flatten(2)
        steps = torch.arange(3, device=depth.device)
        places = ((top[..., None] + steps)[..., :, None] * side + (left[..., None] + steps)[..., None, :]).flatten(2)
        places = places + side**2 * torch.arange(rows, device=depth.device)[:, None, None]
        sums = carried.new_zeros(rows * side**2, 6)
        sums = sums.index_add(0, places.flatten(), (weights[..., None] * carried[:, :, None]).flatten(0, 2))
        inside = slice(PAD, side - PAD)
        sums = sums.view(rows, side, side, 6)[:, inside, inside].movedim(-1, 1)
        mask = 1 - torch.exp(-math.log(2) * sums[:, :1] ** 3)
        means = sums[:, 2:] / sums[:, 1:2].clamp_min(1e-30)
        return Rendering(1 + mask * (means[:, 1:] - 1), mask, means[:, :1])


def _kernel(place: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """First of three pixels of the padded picture that each point touches, and the B-spline's weights there (…, 3)."""
    nearest = place.detach().round().nan_to_num().clamp(-2, size + 1)
    t = (place - nearest).clamp(-0.5, 0.5)
    weights = torch.stack([(0.5 - t).square() / 2, 0.75 - t.square(), (0.5 + t).square() / 2], -1)
    return nearest.long() - 1 + PAD, weights


def _even_points(areas: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Faces (P,) and barycentric shares (P, 3) of points even over a surface, the same each time."""
    ends = areas.double().cumsum(0)
    number = torch.arange(count, dtype=torch.float64)
    face = torch.searchsorted(ends, (number + 0.5) / count * ends[-1]).clamp_max(len(areas) - 1)
    # Roberts' R2 sequence: multiples of the plastic number's inverse powers, even over the unit square.
    u, v = ((0.5 + step * number) % 1 for step in (0.7548776662466927, 0.5698402909980532))
    root = u.sqrt()
    return face, torch.stack([1 - root, root * (1 - v), root * v], 1).float()


def _look_up(texture: Tensor, uv: Tensor) -> Tensor:
    """Bilinear colours (P, 3) at texture coordinates (P, 2)."""
    picture = texture.permute(2, 0, 1)[None]
    found = F.grid_sample(picture, 2 * uv[None, None] - 1, padding_mode="border", align_corners=False)
    return found[0, :, 0].T.contiguous()
