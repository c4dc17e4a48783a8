"""Pairs of pictures whose map is known, for `kfit bench registration`, and how near noise lets one come to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

    from kfit.generators import Template

# Those that come with scikit-image, so that nothing is downloaded.
PICTURES = (
    "astronaut", "brick", "camera", "cat", "coffee", "coins", "immunohistochemistry", "moon", "retina", "rocket",
)  # fmt: skip


@dataclass(frozen=True)
class Pair:
    """A picture, what became of it, the map of pixels (3, 3) from the one to the other, and the gain of its light."""

    template: Tensor
    observed: Tensor
    truth: Tensor
    gain: float


def make_pair(name: str, size: int, noise: float, seed: int, motion: str = "homography") -> Pair:
    """A picture at ``size`` pixels and its twin, both area means of one drawn twice as large.

    The twin is warped there, by Lanczos, so that no method's own interpolation made it; what the warp brings in from
    outside is the picture's own surroundings. Brightness stays within the range. An affine map moves three corners at
    random, and the fourth follows from them.
    """
    import cv2
    import numpy as np
    import torch
    import torch.nn.functional as F
    from skimage import data

    rng = np.random.default_rng([seed, PICTURES.index(name)])
    picture = np.atleast_3d(getattr(data, name)()).astype(np.float32) / 255
    whole, off = 5 * size // 2, size // 4
    crop = torch.from_numpy(picture).permute(2, 0, 1)[None]
    side = min(crop.shape[-2:])
    top, left = (crop.shape[-2] - side) // 2, (crop.shape[-1] - side) // 2
    crop = crop[..., top : top + side, left : left + side]
    large = F.interpolate(crop, (whole, whole), mode="bicubic", antialias=True, align_corners=False).clamp(0, 1)
    middle, roll = (size - 1) / 2, np.deg2rad(rng.uniform(-8, 8))
    scale, shift = np.exp(rng.uniform(-0.08, 0.08)), rng.uniform(-0.06, 0.06, 2) * size
    turn = scale * np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    corners = np.array([[0, 0], [size - 1, 0], [size - 1, size - 1], [0, size - 1]], np.float32)
    apart = rng.uniform(-0.02, 0.02, (4, 2)) * size
    if motion == "affine":
        apart[3] = apart[0] + apart[2] - apart[1]
    moved = (corners - middle) @ turn.T + middle + shift + apart
    truth = cv2.getPerspectiveTransform(corners, moved.astype(np.float32))
    to_large = np.array([[2, 0, off + 0.5], [0, 2, off + 0.5], [0, 0, 1]])
    matrix = to_large @ truth @ np.linalg.inv(to_large)
    pixels = large[0].permute(1, 2, 0).numpy()
    warped = cv2.warpPerspective(pixels, matrix, (whole, whole), flags=cv2.INTER_LANCZOS4).reshape(pixels.shape)
    window = slice(off, off + 2 * size)
    template, twin = (
        F.avg_pool2d(x[..., window, window], 2)[0] for x in (large, torch.from_numpy(warped).permute(2, 0, 1)[None])
    )
    gain = rng.uniform(0.7, 0.9)
    twin = gain * twin + rng.uniform(0.05, 0.95 - gain) + noise * torch.from_numpy(rng.standard_normal(twin.shape))
    return Pair(template, twin.float().clamp(0, 1), torch.from_numpy(truth), gain)


def noise_floor(pair: Pair, noise: float, motion: str = "homography") -> float:
    """What white noise leaves to an unbiased method that knows the picture between its pixels too.

    The root mean square over the corners of their distance in pixels, from the Cramér–Rao bound B σ² (JᵀJ)⁻¹ Bᵀ, where
    J holds the derivatives of the drawn picture, inside the overlap, by gain, bias and the map's parameters at the
    truth, and B those of the corners by these parameters.
    """
    import torch

    from kfit.generators import Template

    generator = Template(pair.template.double(), light=True, oversampling=4)
    corners = generator.corners(pair.truth[None])
    places = corners.new_tensor([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    basis = torch.eye(8).to(corners)
    if motion == "affine":
        coordinates, axes = [*places.T, torch.ones_like(places[:, 0])], torch.eye(2).to(corners)
        basis = torch.stack([torch.outer(c, axis).flatten() for c in coordinates for axis in axes])
    count = len(basis)
    place = torch.cat([corners.flatten(), corners.new_tensor([pair.gain, 0.0])])
    ways = torch.block_diag(basis, torch.eye(2).to(corners))
    step = 1e-4
    moved = torch.cat([place + step * ways, place - step * ways])
    drawn = generator(corners=moved[:, :8].view(-1, 4, 2), gain=moved[:, 8], bias=moved[:, 9]).image
    jacobian = ((drawn[: count + 2] - drawn[count + 2 :]) / (2 * step) * inside(generator, corners)).flatten(1)
    covariance = noise**2 * torch.linalg.inv(jacobian @ jacobian.T)[:count, :count]
    least = (basis.T @ covariance @ basis).trace() / 4
    return float(least.sqrt()) * pair.template.shape[-1] / 2


def inside(generator: Template, corners: Tensor) -> Tensor:
    """1 where the template covers the whole of a pixel of the drawing (1, 1, H, W), else 0."""
    mask = generator(corners=corners).field("mask")
    return (mask > 0.999).to(corners)


def corner_distance(matrix: Tensor, pair: Pair) -> float:
    """Mean distance in pixels between where two maps of pixels (3, 3) take the corners of the picture."""
    from kornia.geometry.linalg import transform_points

    side = pair.template.shape[-1] - 1
    corners = pair.truth.new_tensor([[[0, 0], [side, 0], [side, side], [0, side]]])
    there, here = (transform_points(m[None].to(corners), corners) for m in (matrix, pair.truth))
    return float((there - here).norm(dim=2).mean())
