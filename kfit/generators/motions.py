"""Motions of a picture in its plane: variables, matrices, and sampling positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from kornia.geometry.transform import get_perspective_transform
from torch import Tensor

from kfit.core import Angle, Positive, Variable, Variables

Motion = Literal["translation", "euclidean", "similarity", "affine", "homography", "tps", "flow"]
_ROLL, _SHIFT, _SCALE = {"roll": Variable((), Angle())}, {"shift": Variable((2,))}, {"scale": Variable((), Positive())}
# Motions that are matrices.
LINEAR: dict[str, dict[str, Variable]] = {
    "translation": _SHIFT,
    "euclidean": _ROLL | _SHIFT,
    "similarity": _ROLL | _SHIFT | _SCALE,
    "affine": _ROLL | _SHIFT | _SCALE | {"stretch": Variable((), Positive()), "shear": Variable()},
    "homography": {"corners": Variable((4, 2))},
}
# Non-rigid motions: displacements of control points.
BENDING = ("tps", "flow")
MOTIONS = (*LINEAR, *BENDING)


def motion_variables(motion: str, control: tuple[int, int]) -> dict[str, Variable]:
    """Return the variables of a motion, with control points (rows, columns) if it has any."""
    return dict(LINEAR[motion]) if motion in LINEAR else {"displacement": Variable((2, *control))}


def matrix_of(motion: str, values: Mapping[str, Tensor], size: tuple[int, int]) -> Tensor:
    """Return matrices (N, 3, 3) from the template's pixels to the drawing's, both of ``size`` (H, W)."""
    like = next(iter(values.values()))
    half, middle, flip = _frame(like, size)
    if motion == "homography":
        start = outer_corners(like, size).expand(len(like), 4, 2)
        moved: Tensor = get_perspective_transform(start, start + values["corners"] * half * flip)
        return moved
    linear, shift = _linear(values), values["shift"] * half * flip
    linear = linear * flip[:, None] * flip
    offset = middle + shift - linear @ middle
    bottom = like.new_tensor([0.0, 0.0, 1.0]).expand(len(linear), 1, 3)
    return torch.cat([torch.cat([linear, offset[..., None]], 2), bottom], 1)


def values_of(motion: str, matrix: Tensor, size: tuple[int, int]) -> Variables:
    """Return the values of a motion that moves the corners as a matrix (N, 3, 3) does, or as closely as possible.

    For motions of fewer unknowns than the matrix it is the least-squares solution over the corners, in closed form.
    """
    half, middle, flip = _frame(matrix, size)
    corners = outer_corners(matrix, size).expand(len(matrix), 4, 2)
    there: Tensor = transform_points(matrix, corners)
    if motion == "homography":
        return {"corners": (there - corners) / (half * flip)}
    # About the centres, with y up.
    start, end = (corners - middle) * flip, (there - middle) * flip
    shift = end.mean(1)
    if motion == "translation":
        return {"shift": shift / half}
    product = (end - shift[:, None]).mT @ start  # Σ end · startᵀ, (N, 2, 2)
    # The affine solution: the corners are symmetric, so their second moments are diagonal.
    linear = product / start.square().sum(1)[:, None]
    found = {"shift": shift / half}
    if motion == "affine":
        roll = torch.atan2(linear[:, 1, 0], linear[:, 0, 0])
        scale = torch.linalg.det(linear).clamp_min(1e-6).sqrt()
        cos, sin = roll.cos(), roll.sin()
        first = cos * linear[:, 0, 0] + sin * linear[:, 1, 0]
        second = cos * linear[:, 0, 1] + sin * linear[:, 1, 1]
        return found | {"roll": roll, "scale": scale, "stretch": first / scale, "shear": second / scale}
    cos, sin = product[:, 0, 0] + product[:, 1, 1], product[:, 1, 0] - product[:, 0, 1]
    found["roll"] = torch.atan2(sin, cos)
    if motion == "similarity":
        found["scale"] = torch.hypot(sin, cos) / start.square().sum((1, 2))
    return found


def outer_corners(like: Tensor, size: tuple[int, int]) -> Tensor:
    """Return the outer corners of the picture in pixels, (4, 2), clockwise from the top left."""
    bottom, right = size[0] - 0.5, size[1] - 0.5
    return like.new_tensor([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


def pixel_grid(like: Tensor, size: tuple[int, ...]) -> Tensor:
    """Return the coordinates (x, y) of all pixels, (H, W, 2), or (x, y, z) of all voxels, (D, H, W, 3)."""
    sides = [torch.arange(side, dtype=like.dtype, device=like.device) for side in size]
    return torch.stack(torch.meshgrid(*sides, indexing="ij")[::-1], -1)


def read_through_matrix(matrix: Tensor, size: tuple[int, int]) -> Tensor:
    """Return positions (N, H, W, 2), in template pixels, that a drawing samples if a matrix (N, 3, 3) moves it."""
    # The adjugate is the inverse up to a factor, which does not matter in a projective map, and always exists.
    a, b, c = matrix.unbind(1)
    inverse = torch.stack([torch.linalg.cross(b, c), torch.linalg.cross(c, a), torch.linalg.cross(a, b)], -1)
    points = pixel_grid(matrix, size).view(1, -1, 2)
    x, y, z = (points @ inverse[:, :, :2].mT + inverse[:, None, :, 2]).unbind(-1)
    # Points on the horizon or behind it are outside.
    front = z * torch.linalg.det(matrix)[:, None].sign() > 1e-8
    safe = z.where(front, 1.0)
    read = torch.stack([x / safe, y / safe], -1).where(front[..., None], -1e6)
    return read.view(-1, *size, 2)


def spline_basis(control: tuple[int, int], size: tuple[int, int]) -> Tensor:
    """Return the thin-plate spline (H · W, K) at all pixels for displacements of K control points."""
    from scipy.interpolate import RBFInterpolator  # type: ignore[import-untyped]

    unit = torch.ones((), dtype=torch.float64)
    points = (pixel_grid(unit, control) / unit.new_tensor([control[1] - 1, control[0] - 1])).view(-1, 2)
    pixels = (pixel_grid(unit, size) / unit.new_tensor([size[1] - 1, size[0] - 1])).view(-1, 2)
    spline = RBFInterpolator(points, torch.eye(len(points)).double(), kernel="thin_plate_spline", degree=1)
    return torch.from_numpy(spline(pixels))


def bent(displacement: Tensor, size: tuple[int, int], basis: Tensor | None) -> Tensor:
    """Interpolate displacements (N, 2, rows, columns) of control points at all pixels.

    Args:
        displacement: in half-widths and half-heights, x to the right, y downwards.
        size: (H, W).
        basis: result of `spline_basis`; None interpolates bicubically between the control points.

    Returns:
        (N, H, W, 2) in pixels.
    """
    half = displacement.new_tensor([size[1] / 2, size[0] / 2])
    if basis is not None:
        found = (displacement.flatten(2) @ basis.mT.to(displacement)).view(-1, 2, *size)
    elif displacement.shape[2:] == size:
        found = displacement
    else:
        found = F.interpolate(displacement, size, mode="bicubic", align_corners=True)
    return found.movedim(1, -1) * half


def _frame(like: Tensor, size: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return half of the sides, the centre, and the sign of y, which points down in pixels."""
    height, width = size
    half, middle = like.new_tensor([width / 2, height / 2]), like.new_tensor([(width - 1) / 2, (height - 1) / 2])
    return half, middle, like.new_tensor([1.0, -1.0])


def _linear(values: Mapping[str, Tensor]) -> Tensor:
    """Return linear maps (N, 2, 2), y up."""
    shift = values["shift"]
    roll, scale = values.get("roll", torch.zeros_like(shift[:, 0])), values.get("scale", torch.ones_like(shift[:, 0]))
    cos, sin = scale * roll.cos(), scale * roll.sin()
    turn = torch.stack([cos, -sin, sin, cos], -1).view(-1, 2, 2)
    if "stretch" not in values:
        return turn
    zero, stretch = torch.zeros_like(cos), values["stretch"]
    return turn @ torch.stack([stretch, values["shear"], zero, 1 / stretch], -1).view(-1, 2, 2)
