"""Ambient occlusion of vertices: the darkness inside of a mug and under a handle."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.rasterizer import RASTER_SETTINGS


def with_exposure(
    mesh: Mesh, two_sided: bool | None = False, num_directions: int = 40, floor: float = 0.25, image_size: int = 80
) -> Mesh:
    """Return the mesh with baked ``exposure``, the cosine-weighted fraction of unoccluded directions of each vertex.

    ``e = floor + (1 − floor)·Σ_d w_d·seen_d / Σ_d w_d`` with ``w_d = max(0, n·d)``. Where normals cannot be trusted or
    walls have no thickness, ``two_sided`` takes ``w_d = |n·d|`` and doubles the share, up to 1, since a closed convex
    body hides half of all directions. Each direction is a depth picture from afar.

    Args:
        mesh: A mesh with walls thicker than some hundredth of its box, or drawn ``two_sided``.
        two_sided: Let both sides of a surface count; None lets them where the mesh is no closed, oriented surface.
        num_directions: Directions on the whole sphere.
        floor: Exposure where nothing is seen.
        image_size: Side of the depth pictures in pixels.
    """
    if two_sided is None:
        two_sided = not _is_solid(mesh)
    golden = np.pi * (3 - np.sqrt(5))
    heights = 1 - (2 * np.arange(num_directions) + 1) / num_directions
    angles = golden * np.arange(num_directions)
    rings = np.sqrt(1 - heights**2)
    directions = np.stack([rings * np.cos(angles), heights, rings * np.sin(angles)], axis=1)
    low, high = mesh.bounds
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    total = np.zeros(len(mesh.vertices))
    exposed = np.zeros(len(mesh.vertices))
    distance = 20 * radius
    focal = image_size / 2 * distance / (radius * 1.1)
    for direction in directions:
        across = np.cross([0.0, 1.0, 0.0] if abs(direction[1]) < 0.9 else [1.0, 0.0, 0.0], direction)
        across /= np.linalg.norm(across)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([across, np.cross(direction, across), direction])
        pose[:3, 3] = -pose[:3, :3] @ centre - np.array([0, 0, distance])
        depth = np.full((image_size, image_size), distance * 2, np.float32)
        fov = 2 * np.arctan(image_size / 2 / focal)
        cv2.triangleRasterizeDepth(
            mesh.vertices, mesh.faces, depth, pose, fov, distance * 0.5, distance * 2, RASTER_SETTINGS
        )
        points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        far = -points[:, 2]
        columns = np.rint(points[:, 0] / far * focal + (image_size - 1) / 2).astype(int).clip(0, image_size - 1)
        rows = np.rint(-points[:, 1] / far * focal + (image_size - 1) / 2).astype(int).clip(0, image_size - 1)
        cosine = mesh.normals @ direction
        weight = np.abs(cosine) if two_sided else np.maximum(cosine, 0)
        # A slanted surface's depth changes within a pixel, so the tolerance grows with its slope.
        texel = 2.2 * radius / image_size
        slope = np.sqrt(np.maximum(1 - weight**2, 0)) / np.maximum(weight, 0.2)
        total += weight
        exposed += weight * np.clip(1.5 + slope - (far - depth[rows, columns]) / texel, 0, 1)
    share = np.minimum(1, (2 if two_sided else 1) * exposed / np.maximum(total, 1e-9))
    share = _smoothed(share, mesh.faces)
    return replace(mesh, exposure=(floor + (1 - floor) * share).astype(np.float32))


def _smoothed(values: np.ndarray, faces: np.ndarray, rounds: int = 8) -> np.ndarray:
    """Average values over neighbouring vertices, since each direction's depth picture is coarse."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).ravel()
    others = np.concatenate([faces[:, [1, 0]], faces[:, [2, 1]], faces[:, [0, 2]]]).ravel()
    degree = np.bincount(ends, minlength=len(values))
    for _ in range(rounds):
        mean = np.bincount(ends, weights=values[others], minlength=len(values)) / np.maximum(degree, 1)
        values = np.where(degree > 0, (values + mean) / 2, values)
    return values


def _is_solid(mesh: Mesh) -> bool:
    """Whether nearly every edge lies between two faces of like orientation, with normals on the outer side."""
    _, place = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    corners = place.ravel()[mesh.faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    num = len(mesh.vertices)
    paired = np.isin(edges[:, 0] * num + edges[:, 1], edges[:, 1] * num + edges[:, 0]).mean()
    points = mesh.vertices[mesh.faces]
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    outward = float((across * mesh.normals[mesh.faces].mean(axis=1)).sum(axis=1).mean())
    volume = float((points[:, 0] * across).sum())
    return bool(paired > 0.97 and volume * outward > 0)
