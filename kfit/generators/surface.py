"""The surface of a volume of colour and density, as a mesh."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from kfit.generators.ray_march import EMPTY, SHARPNESS


class Surface(NamedTuple):
    """A closed triangle mesh with a colour at each vertex.

    Attributes:
        vertices: (V, 3) in the object's frame, y up, in box diagonals.
        faces: (F, 3) vertex numbers, anticlockwise as seen from outside.
        colors: (V, 3) RGB in [0, 1].
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.float64]


def surface_of(volume: Tensor, half_sides: Tensor, thickness: float, finer: int = 2) -> Surface:
    """Extract the surface at which a ray through one cell loses half of its light, by marching cubes.

    Source: Lorensen and Cline, 1987.

    Args:
        volume: (4, D, H, W) raw colour and density, the density relative to empty space.
        half_sides: (3,) of the box along x, y and z, in diagonals.
        thickness: optical depth of a diagonal per unit of the density's softplus.
        finer: refinement factor of the grid for marching cubes.

    Raises:
        ValueError: if nothing in the volume is dense enough.
    """
    from skimage.measure import marching_cubes

    sides = volume.shape[1:]
    cell = float(2 * half_sides.mean()) / (sum(sides) / 3)
    # softplus(SHARPNESS · (raw + EMPTY)) · thickness · cell = ln 2
    level = math.log(math.expm1(math.log(2) / (thickness * cell))) / SHARPNESS - EMPTY
    # The outside of the box is empty: a border of empty cells closes the surface.
    padded = F.pad(volume.detach().double().cpu(), [1] * 6)[None]
    size = [(side + 1) * finer + 1 for side in sides]
    dense = F.interpolate(padded[:, 3:], size, mode="trilinear", align_corners=True)[0, 0]
    if not bool((dense > level).any()):
        raise ValueError("the fitted volume has no surface: nothing in it is dense enough")
    found, faces, _, _ = marching_cubes(dense.numpy(), level)
    places = torch.from_numpy(found.copy()).double().flip(1)  # numbers along (z, y, x)
    ends = torch.tensor(size[::-1], dtype=torch.float64) - 1
    grid = (2 * places / ends - 1)[None, None, None]
    raw = F.grid_sample(padded[:, :3], grid, align_corners=True, padding_mode="border")[0, :, 0, 0].T
    cells = torch.tensor(sides[::-1], dtype=torch.float64)
    # The padded grid spans from the centre of the cell before the box to that of the cell after it.
    unit = 2 * (places / finer - 0.5) / cells - 1
    vertices = unit * half_sides.double().cpu()
    # scikit-image's triangles look inwards along (z, y, x), so outwards along the mirrored (x, y, z).
    return Surface(vertices.numpy(), faces.astype(np.int64), torch.sigmoid(raw).numpy())
