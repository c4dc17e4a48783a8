"""Surfaces that objects are made of: sheets, surfaces of revolution, discs, lofts, slabs and swept tubes.

Every function gives a ``Mesh`` part with its own texture; ``kfit.data.mesh.join`` makes one object of many parts.
Lengths are in whatever unit the caller uses; the object is normalised at the end.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes.placing import shift, turn_x


def sheet(points: np.ndarray, texture: np.ndarray) -> Mesh:
    """A smooth sheet through a grid of points.

    Columns run along the texture's width and rows from its bottom to its top, and the front looks along
    (along a row) × (from row to row).

    Args:
        points: Grid (P, N, 3), P ≥ 2 rows of N ≥ 2 points.
        texture: (Ht, Wt, 3) uint8.
    """
    points = np.asarray(points, np.float64)
    rows, columns = points.shape[:2]
    along = np.gradient(points, axis=1)
    if np.allclose(points[:, 0], points[:, -1]):
        along[:, 0] = along[:, -1] = (points[:, 1] - points[:, -2]) / 2
    up = np.gradient(points, axis=0)
    normals = np.cross(along, up)
    lengths = np.linalg.norm(normals, axis=2, keepdims=True)
    # A row shrunk to a point has no direction along itself: it takes its neighbour's mean.
    for row, other in ((0, 1), (rows - 1, rows - 2)):
        if lengths[row].max() < 1e-9 * max(float(lengths.max()), 1e-30) or np.ptp(points[row], axis=0).max() < 1e-9:
            normals[row] = normals[other].mean(axis=0)
            lengths[row] = np.linalg.norm(normals[row], axis=1, keepdims=True)
    normals /= np.maximum(lengths, 1e-12)
    u, v = np.meshgrid(_sides(points.transpose(1, 0, 2)), 1 - _sides(points))
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh(
        vertices=points.reshape(-1, 3).astype(np.float32),
        faces=faces.astype(np.int32),
        normals=normals.reshape(-1, 3).astype(np.float32),
        uv=np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32),
        texture=texture,
    )


def _sides(points: np.ndarray) -> np.ndarray:
    """Places (P,) in [0, 1] of a grid's rows, by the mean distances between them, so that textures are not squeezed."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    place = np.concatenate([[0], np.cumsum(steps)])
    return place / max(float(place[-1]), 1e-12)


def smooth(points: np.ndarray, num: int) -> np.ndarray:
    """``num`` points of a Catmull–Rom curve through control points (P, D), evenly spread over the arcs' lengths."""
    points = np.asarray(points, np.float64)
    padded = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    place = np.linspace(0, lengths.sum(), num)
    ends = np.concatenate([[0], np.cumsum(lengths)])
    arc = np.clip(np.searchsorted(ends, place, side="right") - 1, 0, len(lengths) - 1)
    t = ((place - ends[arc]) / np.maximum(lengths[arc], 1e-12))[:, None]
    p0, p1, p2, p3 = (padded[arc + k] for k in range(4))
    curve: np.ndarray = 2 * p1 + (p2 - p0) * t
    curve = curve + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * p1 - p0 - 3 * p2 + p3) * t**3
    return curve / 2


def revolve(profile: np.ndarray, texture: np.ndarray, num_around: int = 48, section: np.ndarray | None = None) -> Mesh:
    """Turn a profile about the y axis, or loft it along a section that is not a circle.

    The texture wraps once around, starting at +z and going to +x, so it reads left to right from outside. A profile
    that climbs shows its outside, one that descends its inside.

    Args:
        profile: (P, 2) radius and height, smooth throughout; creases are where one profile ends and the next begins.
        texture: (Ht, Wt, 3) uint8.
        num_around: Steps around for a circle.
        section: (N + 1, 2) closed outline in (x, z) that a radius of 1 scales, in the order of ``circle``.
    """
    outline = circle(num_around) if section is None else section
    profile = np.asarray(profile, np.float64)
    points = np.empty((len(profile), len(outline), 3))
    points[..., 0] = profile[:, :1] * outline[:, 0]
    points[..., 1] = profile[:, 1:]
    points[..., 2] = profile[:, :1] * outline[:, 1]
    return sheet(points, texture)


def circle(num_around: int = 48) -> np.ndarray:
    """Closed unit circle (num_around + 1, 2) in (x, z), from +z towards +x."""
    angle = np.linspace(0, 2 * np.pi, num_around + 1)
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def rounded_rectangle(width: float, depth: float, radius: float, per_corner: int = 6, per_side: int = 5) -> np.ndarray:
    """Closed outline (4·(per_corner + per_side) + 1, 2) in (x, z) of a rectangle with rounded corners.

    It runs in the order of ``circle`` and starts in the middle of the +z side, as a wrapped texture does.
    """
    radius = min(radius, width / 2, depth / 2)
    corners = [(1, 1, 0.0), (1, -1, 90.0), (-1, -1, 180.0), (-1, 1, 270.0)]
    points = []
    for sx, sz, start in corners:
        angle = np.deg2rad(np.linspace(start, start + 90, per_corner))
        cx, cz = sx * (width / 2 - radius), sz * (depth / 2 - radius)
        points.append(np.stack([cx + radius * np.sin(angle), cz + radius * np.cos(angle)], axis=1))
        gap = (
            points[-1][-1]
            + (np.array(_next_corner(sx, sz, width, depth, radius)) - points[-1][-1])
            * np.linspace(0, 1, per_side + 2)[1:-1, None]
        )
        points.append(gap)
    outline = np.concatenate(points)
    outline = np.roll(outline, per_side // 2, axis=0)
    return np.concatenate([outline, outline[:1]])


def _next_corner(sx: int, sz: int, width: float, depth: float, radius: float) -> tuple[float, float]:
    """Where the arc after the one at corner (sx, sz) begins."""
    if sx * sz > 0:
        return sx * width / 2, -sz * (depth / 2 - radius)
    return -sx * (width / 2 - radius), sz * depth / 2


def plate(outline: np.ndarray, height: float, texture: np.ndarray, facing: int = 1, num_rings: int = 5) -> Mesh:
    """A flat plate at y = height inside an outline, its texture laid flat over the outline's box.

    Seen along its normal with −z up, the texture is upright: columns run along +x and rows along +z for a plate that
    faces up, and columns along −x for one that faces down.

    Args:
        outline: (N + 1, 2) closed, star-shaped about its box's centre, in (x, z), in the order of ``circle``.
        height: The plate's y.
        texture: (Ht, Wt, 3) uint8.
        facing: 1 for up, −1 for down.
        num_rings: Rings of vertices between the centre and the outline, which carry the baked exposure.
    """
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre = (low + high) / 2
    share = np.linspace(1, 0, num_rings + 1)[:, None, None]
    flat = centre + (outline - centre) * share
    points = np.stack([flat[..., 0], np.full(flat.shape[:2], height), flat[..., 1]], axis=-1)
    mesh = sheet(points if facing > 0 else points[::-1], texture)
    place = (mesh.vertices[:, [0, 2]] - low) / np.maximum(high - low, 1e-12)
    if facing < 0:
        place[:, 0] = 1 - place[:, 0]
    normals = np.tile(np.array([0, facing, 0], np.float32), (len(mesh.vertices), 1))
    return Mesh(mesh.vertices, mesh.faces, normals, place.astype(np.float32), texture)


def slab(
    outline: np.ndarray,
    bottom: float,
    top: float,
    bevel: float,
    textures: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> list[Mesh]:
    """A solid between two heights with bevelled edges: top plate, side and bottom plate.

    Args:
        outline: Closed outline in (x, z), see ``plate``.
        bottom: Lower y.
        top: Upper y.
        bevel: Width of the rounded edge, at most half the thickness.
        textures: Of the top, the side and the bottom.
    """
    bevel = min(bevel, (top - bottom) / 2)
    half = np.ptp(outline, axis=0).min() / 2
    inner = outline * (1 - bevel / half)
    angle = np.linspace(0, np.pi / 2, 4)
    shares = 1 - bevel / half * (1 - np.sin(angle))
    low = [(share, bottom + bevel * (1 - c)) for share, c in zip(shares, np.cos(angle), strict=True)]
    high = [(share, top - bevel * (1 - c)) for share, c in zip(shares[::-1], np.cos(angle)[::-1], strict=True)]
    side = revolve(np.array(low + high), textures[1], section=outline)
    return [plate(inner, top, textures[0]), side, plate(inner, bottom, textures[2], facing=-1)]


def polygon(corners: Sequence[tuple[float, float]], per_side: int = 3) -> np.ndarray:
    """Closed outline (per_side·corners + 1, 2) through corners in (x, z) given in the order of ``circle``."""
    points = np.array([*corners, corners[0]], np.float64)
    share = np.linspace(0, 1, per_side + 1)[:-1, None]
    sides = [start + (stop - start) * share for start, stop in itertools.pairwise(points)]
    return np.concatenate([*sides, points[:1]])


def extrusion(outline: np.ndarray, thickness: float, bevel: float, texture: np.ndarray) -> list[Mesh]:
    """A solid whose outline lies in (x, y), in the order of ``circle``, and which is thick along z about z = 0.

    The outline must be star-shaped about its box's centre.
    """
    centre = (outline.min(axis=0) + outline.max(axis=0)) / 2
    parts = slab(outline - centre, -thickness / 2, thickness / 2, bevel, (texture, texture, texture))
    return [part.transformed(shift(centre[0], centre[1], 0) @ turn_x(-np.pi / 2)) for part in parts]


def tube(
    path: np.ndarray,
    radii: np.ndarray | Sequence[float],
    texture: np.ndarray,
    num_around: int = 12,
    axis: np.ndarray | Sequence[float] = (0.0, 0.0, 1.0),
) -> Mesh:
    """A tube of elliptic section swept along a path.

    Args:
        path: (P, 3).
        radii: (2,) or (P, 2): half width across the path and the axis, and half width along the axis.
        texture: (Ht, Wt, 3) uint8; rows run along the path.
        num_around: Steps around the section.
        axis: (3,) or (P, 3) of unit length, nowhere along the path.
    """
    path = np.asarray(path, np.float64)
    radii = np.broadcast_to(np.asarray(radii, np.float64), (len(path), 2))
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    across = np.cross(tangent, np.broadcast_to(np.asarray(axis, np.float64), path.shape))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    along = np.cross(across, tangent)
    angle = np.linspace(0, 2 * np.pi, num_around + 1)
    offset = radii[:, :1, None] * np.cos(angle)[None, :, None] * across[:, None]
    offset = offset - radii[:, 1:, None] * np.sin(angle)[None, :, None] * along[:, None]
    return sheet(path[:, None] + offset, texture)
