"""Cameras: intrinsics, viewing rays, and the way from a fitted crop to a pose in the photo's camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor

from kfit.core import Observation
from kfit.core.check import check_count, check_range
from kfit.geometry.crop import Crop
from kfit.geometry.pose import rotation_from_angles, to_opencv

# Width of a unit diagonal at the object's centre over the width of the picture, as the generator draws it at scale 1.
UNIT_FRACTION = 0.95
# EXIF tag numbers (Exif 2.32, tables 8 and 9).
_FOCAL_LENGTH, _FOCAL_LENGTH_35MM, _PIXELS_X, _PIXELS_Y = 0x920A, 0xA405, 0xA002, 0xA003
_FOCAL_PLANE_X_RESOLUTION, _FOCAL_PLANE_UNIT = 0xA20E, 0xA210
# Proportions that differ by less do so by rounding.
_ALIKE = 0.01
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}


def intrinsics_from_fov(width: int, height: int, fov_deg: float = 60.0) -> Tensor:
    """Intrinsics of an ideal camera that sees ``fov_deg`` along the photo's longer side.

    f = max(width, height) / (2 tan(fov / 2)), principal point ((width − 1) / 2, (height − 1) / 2). The default lies
    between a phone's main lens (26 mm on film: 67°) and a normal lens (50 mm: 39°); a wrong angle changes the distance
    in proportion to f and tilts an object off the centre by a few degrees.

    Returns:
        (3, 3), pixels with centres at integers.

    Raises:
        ValueError: if a side is below 1 or the angle not between 1 and 179.
    """
    check_count("width", width)
    check_count("height", height)
    check_range("fov_deg", fov_deg, 1, 179)
    return _intrinsics(max(width, height) / (2 * math.tan(math.radians(fov_deg) / 2)), width, height)


def intrinsics_from_exif(tags: Mapping[int, Any], width: int, height: int) -> Tensor | None:
    """Intrinsics by a photo's EXIF tags, or None where they do not tell.

    By FocalLengthIn35mmFilm F, which compares *diagonals* (CIPA DCG-001), f = F · √(w² + h²) / √(36² + 24²), or
    without it by FocalLength times FocalPlaneXResolution. Both hold for the photo as it was taken, of
    w × h = PixelXDimension × PixelYDimension pixels. One of the same proportions has been scaled since, and f with it;
    one of other proportions has been cropped, and f stays (see `was_cropped`).

    Args:
        tags: values by tag number, those of the Exif sub-directory among them.
        width, height: of the photo as it is now, in pixels.

    Returns:
        (3, 3), pixels with centres at integers; the principal point is the photo's middle.
    """
    taken = _taken(tags, width, height)
    scale = 1.0 if was_cropped(tags, width, height) else max(width, height) / taken[0]
    on_film = _number(tags, _FOCAL_LENGTH_35MM)
    if on_film:
        return _intrinsics(scale * on_film * math.hypot(*taken) / math.hypot(36, 24), width, height)
    focal, resolution = _number(tags, _FOCAL_LENGTH), _number(tags, _FOCAL_PLANE_X_RESOLUTION)
    unit = _UNIT_MM.get(int(_number(tags, _FOCAL_PLANE_UNIT) or 2))
    if not (focal and resolution and unit):
        return None
    return _intrinsics(scale * focal * resolution / unit, width, height)


def was_cropped(tags: Mapping[int, Any], width: int, height: int) -> bool:
    """Whether a photo is a part of the one that its EXIF tags name: no larger, and of other proportions.

    Args:
        tags: as in `intrinsics_from_exif`.
        width, height: of the photo as it is now, in pixels; it may have been turned upright.
    """
    taken, now = _taken(tags, width, height), (max(width, height), min(width, height))
    if now[0] > taken[0] or now[1] > taken[1]:
        return False
    across, down = now[0] / taken[0], now[1] / taken[1]
    return abs(across - down) > _ALIKE * max(across, down)


def viewing_ray(pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Unit direction (…, 3) in OpenCV axes of the ray through a pixel (…, 2); intrinsics (…, 3, 3)."""
    homogeneous = torch.cat((pixel, torch.ones_like(pixel[..., :1])), -1)
    ray = torch.linalg.solve(intrinsics.to(pixel), homogeneous[..., None])[..., 0]
    unit: Tensor = ray / ray.norm(dim=-1, keepdim=True)
    return unit


def viewing_ray_rotation(pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Smallest rotation that takes the optical axis to the ray through a pixel.

    A crop off the photo's middle looks as if the camera had looked straight at it, so R_cam = R_ray · R_crop.

    Args:
        pixel: (…, 2).
        intrinsics: (…, 3, 3).

    Returns:
        (…, 3, 3) in OpenCV axes, whose third column is the ray.
    """
    x, y, z = viewing_ray(pixel, intrinsics).unbind(-1)
    # Unit vectors a and b: the quaternion (1 + a·b, a × b) turns a into b by the shortest way.
    rotation: Tensor = quaternion_to_rotation_matrix(torch.stack((1 + z, -y, x, torch.zeros_like(z)), -1))
    return rotation


def pose_from_crop(
    azimuth: Tensor,
    elevation: Tensor,
    roll: Tensor,
    shift: Tensor,
    scale: Tensor,
    crop: Crop,
    intrinsics: Tensor,
    diagonal: float | Tensor,
    unit_fraction: float = UNIT_FRACTION,
) -> tuple[Tensor, Tensor]:
    """Pose in the photo's camera of an object fitted in a crop of the photo.

    The generator's camera looks straight at the *object's* centre, wherever the shift then moves the picture. So that
    camera's axis is the ray through the pixel p = centre + side / 2 · (shift_x, −shift_y), at an angle θ to the photo's
    axis, and R = R_ray · diag(1, −1, −1) · Rz(roll) Rx(elevation) Ry(azimuth). On this ray at distance t, a diagonal D
    subtends D / t. A small angle spans f / cos²θ photo pixels along the radius and f / cos θ across it: as a similarity
    has one scale, their geometric mean. It is seen as scale · unit_fraction · side pixels, hence

        t = f · D / (scale · unit_fraction · side · cos^{3/2} θ),    translation = t · ray.

    On the axis this is tz = f D / (scale · crop_px); off it the photo is stretched, which no similarity can follow:
    by 1 / cos θ, that is 2 % at 10° and 10 % at 25°.

    Args:
        azimuth, elevation, roll: (N,) in radians.
        shift: (N, 2) right and up, in half-widths of the picture.
        scale: (N,) above 0.
        crop: the square that was fitted.
        intrinsics: (3, 3) or (N, 3, 3) of the photo.
        diagonal: of the object's bounding box in metres, a number or (N,).
        unit_fraction: width of a unit diagonal over the picture's, at scale 1.

    Returns:
        rotation (N, 3, 3) and translation (N, 3) in metres: object to camera, OpenCV axes.
    """
    offset = shift * shift.new_tensor([crop.side / 2, -crop.side / 2])
    pixel = offset + shift.new_tensor(crop.centre)
    rotation = viewing_ray_rotation(pixel, intrinsics) @ to_opencv(rotation_from_angles(azimuth, elevation, roll))
    ray = viewing_ray(pixel, intrinsics)
    focal = (intrinsics[..., 0, 0] + intrinsics[..., 1, 1]).to(shift) / 2
    distance = focal * diagonal / (scale * unit_fraction * crop.side * ray[..., 2] ** 1.5)
    return rotation, distance[..., None] * ray


def diagonal_at(
    distance: Tensor,
    shift: Tensor,
    scale: Tensor,
    crop: Crop,
    intrinsics: Tensor,
    unit_fraction: float = UNIT_FRACTION,
) -> Tensor:
    """Box diagonal (N,) in metres of an object seen at a known distance (N,) along its ray: what `pose_from_crop` must
    be given to put it there. Arguments as there.
    """
    one = torch.ones_like(distance)
    zero = torch.zeros_like(distance)
    _, unit = pose_from_crop(zero, zero, zero, shift, scale, crop, intrinsics, one, unit_fraction)
    diagonal: Tensor = distance / unit.norm(dim=-1)
    return diagonal


def depth_along(depth: Tensor, pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Depth (H, W) along the photo's axis as depth along the ray through a pixel (2,), both in metres.

    d = z · r · K⁻¹ (u, v, 1) with r the ray's unit direction.
    """
    height, width = depth.shape
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    points = torch.linalg.solve(intrinsics, torch.stack([u, v, torch.ones_like(u)]).flatten(1).to(intrinsics))
    along: Tensor = depth * (viewing_ray(pixel.to(intrinsics), intrinsics) @ points).view(height, width).to(depth)
    return along


def observed(crop: Crop, image: Any, mask: Any, depth: Any, intrinsics: Tensor) -> Observation:
    """What `Crop.cut` gives, with the photo's depth (H, W) along the ray of the crop's middle, and the crop's camera.

    Errors are those of `Crop.cut`.
    """
    along = depth_along(torch.as_tensor(depth), torch.tensor(crop.centre), intrinsics)
    return replace(crop.cut(image, mask, along), intrinsics=(crop.image_to_crop @ intrinsics).float()[None])


def _intrinsics(focal: float, width: int, height: int) -> Tensor:
    return torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


def _taken(tags: Mapping[int, Any], width: int, height: int) -> tuple[float, float]:
    """The longer and the shorter side of the photo as it was taken; what no tag tells is as it is now."""
    longer, shorter = max(width, height), min(width, height)
    sides = [side for side in (_number(tags, _PIXELS_X), _number(tags, _PIXELS_Y)) if side is not None]
    if len(sides) < 2:
        longest = max(sides, default=longer)
        return longest, longest * shorter / longer
    return max(sides), min(sides)


def _number(tags: Mapping[int, Any], tag: int) -> float | None:
    """A tag as a number above 0; cameras write 0, 0/0 and worse for "unknown"."""
    try:
        number = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < math.inf else None
