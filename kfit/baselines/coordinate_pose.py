"""From object coordinates and depth to a pose: a similarity, then ICP on depth."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree  # type: ignore[import-untyped]
from torch import Tensor

from kfit.core.check import check_shape
from kfit.data.nocs_alignment import align
from kfit.geometry import viewing_ray

# Of the object's size: how far a point may lie from where its coordinates put it and still agree, and from the other
# cloud and still be compared with it.
TOLERANCE, NEAR = 0.1, 0.03
# Settings of OpenCV's ICP: iterations, least change, rejection in robust deviations, sizes of its pyramid.
ICP = (50, 1e-4, 2.5, 3)
LEAST_POINTS = 16


def pose_of_coordinates(
    coordinates: Tensor, mask: Tensor, depth: Tensor, intrinsics: Tensor, refine: bool = True
) -> tuple[Tensor, Tensor, float]:
    """Estimate pose and size of an object from the coordinates of its pixels.

    RANSAC over similarities D R x + t from coordinates to the depth's points (Wang et al. 2019, section 5), then
    point-to-plane ICP of the posed coordinates on the depth's points (OpenCV's), which changes R and t alone. ICP is
    kept only if it lowers the mean distance of the points to the nearest plane and at least as many points agree with
    their coordinates; without the latter it was worse more often than better.

    Args:
        coordinates: (3, S, S) in box diagonals, see `CoordinateRegressor`.
        mask: (S, S), above 1/2 on the object.
        depth: (S, S) in metres along the ray through the picture's middle, as `kfit.geometry.observed` gives it (along
            the axis where that is the middle); unknown where it is NaN or not above 0.
        intrinsics: (3, 3) of the picture.
        refine: whether ICP follows the similarity.

    Returns:
        rotation (3, 3) and translation (3,) in metres, object to camera in OpenCV's axes, and the box's diagonal in
        metres.

    Raises:
        ValueError: if fewer than 16 pixels of the object have depth, or no similarity explains 0.1 of them.
    """
    check_shape("coordinates", coordinates, (3, "S", "S"))
    for name, value in {"mask": mask, "depth": depth}.items():
        check_shape(name, value, tuple(coordinates.shape[1:]))
    check_shape("intrinsics", intrinsics, (3, 3))
    points = _points(depth, intrinsics)
    known = (mask > 0.5).cpu().numpy() & np.isfinite(points).all(-1)
    if known.sum() < LEAST_POINTS:
        raise ValueError(f"depth: {known.sum()} pixels of the object have it, and at least {LEAST_POINTS} are needed")
    predicted = coordinates.detach().cpu().double().movedim(0, -1).numpy()
    size = float(points[known].std(0).sum() / max(predicted[known].std(0).sum(), 1e-9))
    matrix = align(predicted[known], points[known], tolerance=TOLERANCE * size)
    diagonal = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    pose = matrix.copy()
    pose[:3, :3] /= diagonal
    if refine:
        posed = diagonal * predicted @ pose[:3, :3].T + pose[:3, 3]
        pose = _refined(posed, points, known, NEAR * size) @ pose
    return torch.from_numpy(pose[:3, :3].copy()), torch.from_numpy(pose[:3, 3].copy()), diagonal


def _points(depth: Tensor, intrinsics: Tensor) -> NDArray[np.float64]:
    """Return camera points (S, S, 3) of depth along the middle's ray, NaN where unknown."""
    camera = intrinsics.detach().cpu().double()
    v, u = torch.meshgrid(*(torch.arange(size, dtype=torch.float64) for size in depth.shape), indexing="ij")
    rays = torch.linalg.solve(camera, torch.stack([u, v, torch.ones_like(u)]).flatten(1)).T
    middle = torch.tensor([(depth.shape[1] - 1) / 2, (depth.shape[0] - 1) / 2], dtype=torch.float64)
    away = depth.detach().cpu().double()
    away = away.where(away > 0, torch.nan) / (rays @ viewing_ray(middle, camera)).view(depth.shape)
    points: NDArray[np.float64] = (rays.view(*depth.shape, 3) * away[..., None]).numpy()
    return points


def _normals(points: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return unit normals (S, S, 3) of the surface through neighbouring pixels, NaN where one is missing."""
    there = np.where(known[..., None], points, np.nan)
    across, down = (np.gradient(there, axis=axis) for axis in (1, 0))
    normal = np.cross(across, down)
    found: NDArray[np.float64] = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    return found


def _refined(
    posed: NDArray[np.float64], points: NDArray[np.float64], known: NDArray[np.bool_], far: float
) -> NDArray[np.float64]:
    """Return the rigid motion (4, 4) of the posed coordinates to the depth's points; the identity if none is better.

    Pairs further apart than ``far`` count as far.
    """
    clouds = []
    for cloud in (posed, points):
        normal = _normals(cloud, known)
        sound = known & np.isfinite(normal).all(-1)
        clouds.append(np.concatenate([cloud[sound], normal[sound]], 1).astype(np.float32))
    source, target = clouds
    if min(len(source), len(target)) < LEAST_POINTS:
        return np.eye(4)
    _, _, moved = cv2.ppf_match_3d.ICP(*ICP).registerModelToScene(source, target)
    if not np.isfinite(moved).all():
        return np.eye(4)
    tree = cKDTree(target[:, :3])

    def residual(matrix: NDArray[np.float64]) -> float:
        there = source[:, :3] @ matrix[:3, :3].T + matrix[:3, 3]
        distance, nearest = tree.query(there)
        plane = np.abs(((there - target[nearest, :3]) * target[nearest, 3:]).sum(1))
        return float(np.where(distance < far, plane, far).mean())

    def agree(matrix: NDArray[np.float64]) -> int:
        there = posed[known] @ matrix[:3, :3].T + matrix[:3, 3]
        return int((np.linalg.norm(there - points[known], axis=1) < far).sum())

    stay = np.eye(4)
    # A partial surface can slide along itself to a closer but wrong place, so its coordinates must still agree.
    better = residual(moved) < residual(stay) and agree(moved) >= agree(stay)
    chosen: NDArray[np.float64] = moved if better else stay
    return chosen
