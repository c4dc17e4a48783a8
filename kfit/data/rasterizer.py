"""Rendering of meshes without a display: colour, mask, depth and object coordinates, by OpenCV's rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from kfit.core.arguments import check_arguments
from kfit.data.light import Light
from kfit.data.mesh import Mesh
from kfit.geometry import UNIT_FRACTION

DISTANCE = 4.0
"""Distance of the standard camera from the object's centre, in box diagonals."""

RASTER_SETTINGS = (
    cv2.TriangleRasterizeSettings()
    .setCullingMode(cv2.RASTERIZE_CULLING_NONE)
    .setShadingType(cv2.RASTERIZE_SHADING_SHADED)
    .setGlCompatibleMode(cv2.RASTERIZE_COMPAT_DISABLED)
)


@dataclass(frozen=True)
class View:
    """The picture of a camera, in float32.

    ``image`` (H, W, 3) RGB in [0, 1] on white, ``mask`` (H, W) coverage in [0, 1], ``depth`` (H, W) along the viewing
    axis in the mesh's unit and ``coords`` (H, W, 3) in the mesh's frame, both 0 where nothing is.

    Example:
        >>> import numpy as np
        >>> from kfit.data import Light, build, pose_view
        >>> mug = build("mug", seed=0)[0]
        >>> view = pose_view(mug.normalised(), elevation=0.5, azimuth=0.3, light=Light.random(np.random.default_rng(0)))
        >>> view.image.shape, bool(view.mask[32, 32] > 0.5)
        ((64, 64, 3), True)
    """

    image: np.ndarray
    mask: np.ndarray
    depth: np.ndarray
    coords: np.ndarray


def render(
    mesh: Mesh, world2cam: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int], light: Light, supersample: int = 2
) -> View:
    """Render a mesh.

    The camera's frame is x right, y up, z towards the viewer, so what it sees has negative z. A point (x, y, z) falls
    on column ``fx·x/(−z) + cx`` and row ``−fy·y/(−z) + cy`` with pixel centres at integers. Colour and mask are means
    over ``supersample`` by as many samples a pixel, on white; depth is the mean over the samples that hit, and coords
    follow from it, so that the two agree exactly.

    Args:
        mesh: What to draw.
        world2cam: (4, 4) rigid map from the mesh's frame to the camera's.
        intrinsics: (3, 3) pinhole matrix in pixels, no skew.
        size: Height and width in pixels.
        light: Lamps, in the mesh's frame.
        supersample: Samples a pixel along each side.

    Raises:
        ValueError: If a part of the mesh lies at or behind the camera, which the rasterizer cannot clip.

    Example:
        >>> import numpy as np
        >>> from kfit.data import Light, build, render
        >>> from kfit.data.rasterizer import standard_intrinsics, standard_pose
        >>> mug, light = build("mug", seed=0)[0].normalised(), Light.random(np.random.default_rng(0))
        >>> render(mug, standard_pose(0.5, 0.3), standard_intrinsics(64), (64, 64), light).image.shape
        (64, 64, 3)
    """
    check_arguments(render, locals(), supersample=(1, 16))
    height, width = size
    rotation, shift = world2cam[:3, :3], world2cam[:3, 3]
    along = -(mesh.vertices @ rotation[2] + shift[2])
    near, far = float(along.min()), float(along.max())
    if near <= 1e-3 * max(far, 1e-9):
        raise ValueError(
            f"world2cam must put all of the mesh in front of the camera, but a vertex has depth {near:.4g}."
        )
    shape = (height * supersample, width * supersample)
    depth = np.full(shape, far * 2, np.float32)
    uve, packed = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.float32)
    sheared, fov = _camera(world2cam, intrinsics, size)
    args = (sheared, fov, near / 2, far * 2, RASTER_SETTINGS)
    attributes = np.concatenate([mesh.uv, mesh.exposure[:, None]], axis=1)
    cv2.triangleRasterize(mesh.vertices, mesh.faces, attributes, uve, depth, *args)
    # The rasterizer interpolates what lies in [0, 1]; a second pass over an untouched buffer carries the normals.
    cv2.triangleRasterizeColor(mesh.vertices, mesh.faces, (mesh.normals + 1) / 2, packed, *args)
    hit = depth < far * 1.5
    colors = np.ones((*shape, 3), np.float32)
    if hit.any():
        normal = packed[hit] * 2 - 1
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
        eye = -rotation.T @ shift
        sample_intrinsics = _supersampled(intrinsics, supersample)
        toward = eye - _unproject(depth, world2cam, sample_intrinsics)[hit]
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        albedo = _lookup(mesh.texture, uve[hit])
        colors[hit] = light.shade(albedo, normal, toward.astype(np.float32), uve[hit][:, 2])
    blocks = (height, supersample, width, supersample)
    mask = hit.reshape(blocks).mean((1, 3), dtype=np.float32)
    mean_depth = np.where(hit, depth, 0).reshape(blocks).mean((1, 3), dtype=np.float32) / np.maximum(mask, 1e-6)
    coords = _unproject(mean_depth, world2cam, intrinsics) * (mask > 0)[..., None]
    image = colors.reshape(*blocks, 3).mean((1, 3), dtype=np.float32)
    return View(image, mask, np.where(mask > 0, mean_depth, 0), coords.astype(np.float32))


def pose_view(
    mesh: Mesh,
    elevation: float,
    azimuth: float,
    light: Light,
    image_size: int = 64,
    distance: float = DISTANCE,
    unit_fraction: float = UNIT_FRACTION,
    supersample: int = 2,
) -> View:
    """Render a normalised mesh with the standard camera at an elevation and azimuth in radians, roll 0.

    ``R_cam_obj = Rx(elevation)·Ry(azimuth)``; the camera stands ``distance`` diagonals away on its own z axis and looks
    at the object's centre; its focal length is that of ``standard_intrinsics``.

    Example:
        >>> import numpy as np
        >>> from kfit.data import Light, build, pose_view
        >>> mug = build("mug", seed=0)[0]
        >>> view = pose_view(mug.normalised(), elevation=0.5, azimuth=0.3, light=Light.random(np.random.default_rng(0)))
        >>> view.image.shape, bool(view.mask[32, 32] > 0.5)
        ((64, 64, 3), True)
    """
    check_arguments(pose_view, locals(), distance=(1, 1e6), unit_fraction=(0.1, 10))
    return render(
        mesh,
        standard_pose(float(elevation), float(azimuth), distance),
        standard_intrinsics(image_size, distance, unit_fraction),
        (image_size, image_size),
        light,
        supersample,
    )


def standard_pose(elevation: float, azimuth: float, distance: float = DISTANCE) -> np.ndarray:
    """Return the map (4, 4) from the object's frame to the standard camera's for angles in radians."""
    ce, se, ca, sa = np.cos(elevation), np.sin(elevation), np.cos(azimuth), np.sin(azimuth)
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, ce, -se], [0, se, ce]]) @ np.array([[ca, 0, sa], [0, 1, 0], [-sa, 0, ca]])
    pose[2, 3] = -distance
    return pose


def standard_intrinsics(
    image_size: int, distance: float = DISTANCE, unit_fraction: float = UNIT_FRACTION
) -> np.ndarray:
    """Return the pinhole matrix (3, 3) of the standard camera in pixels, pixel centres at integers.

    The sphere of unit diameter, which holds every normalised object, has a silhouette ``unit_fraction`` times as wide
    as the picture at any distance D: ``focal = unit_fraction · image_size · √(D² − 1/4)``.
    """
    check_arguments(standard_intrinsics, locals(), distance=(1, 1e6))
    focal, centre = unit_fraction * image_size * np.sqrt(distance**2 - 0.25), (image_size - 1) / 2
    return np.array([[focal, 0, centre], [0, focal, centre], [0, 0, 1]])


def _camera(world2cam: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, float]:
    """Return a camera with square pixels and a centred axis; a shear of world2cam compensates the difference."""
    height, width = size
    fx, fy, cx, cy = intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]
    shear = np.eye(4)
    shear[0, 0], shear[0, 2], shear[1, 2] = fx / fy, -(cx - (width - 1) / 2) / fy, (cy - (height - 1) / 2) / fy
    return shear @ world2cam, float(2 * np.arctan(height / (2 * fy)))


def _supersampled(intrinsics: np.ndarray, factor: int) -> np.ndarray:
    """Return intrinsics for a picture with ``factor`` samples along each side of a pixel."""
    scaled: np.ndarray = intrinsics * np.array([[factor], [factor], [1.0]])
    scaled[:2, 2] += (factor - 1) / 2
    return scaled


def _unproject(depth: np.ndarray, world2cam: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Return points (H, W, 3) in the mesh's frame of a depth picture (H, W)."""
    height, width = depth.shape
    x = (np.arange(width) - intrinsics[0, 2]) / intrinsics[0, 0]
    y = -(np.arange(height) - intrinsics[1, 2]) / intrinsics[1, 1]
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
    points: np.ndarray = (rays * depth[..., None] - world2cam[:3, 3]) @ world2cam[:3, :3]
    return points


def _lookup(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return bilinear colours (M, 3) in [0, 1] at texture coordinates (M, ≥2)."""
    size = np.array(texture.shape[1::-1], np.float32)
    place = uv[:, :2] * size - 0.5
    # cv2.remap takes fewer than 32768 columns and rows, so a long list of points is folded into rows of 256.
    rows = -(-len(place) // 256)
    folded = np.zeros((rows * 256, 2), np.float32)
    folded[: len(place)] = place
    found: np.ndarray = cv2.remap(
        texture, folded.reshape(rows, 256, 2), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return found.reshape(-1, 3)[: len(place)].astype(np.float32) / 255
