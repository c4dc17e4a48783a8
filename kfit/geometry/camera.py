"""Cameras: intrinsics, viewing rays, and the way from a fitted crop to a pose in the photo's camera."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor

from kfit.core import Observation
from kfit.core.check import check_count, check_range
from kfit.geometry.crop import Crop
from kfit.geometry.pose import rotation_from_angles, to_opencv

# Share of the picture's width that the silhouette of the object's bounding sphere spans at scale 1.
UNIT_FRACTION = 0.95


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
    return centred_intrinsics(max(width, height) / (2 * math.tan(math.radians(fov_deg) / 2)), width, height)


def centred_intrinsics(focal: float, width: int, height: int) -> Tensor:
    """Intrinsics (3, 3) of a focal length in pixels, with the principal point in the photo's middle."""
    return torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


def with_focal(intrinsics: Tensor, focal: Tensor) -> Tensor:
    """The same cameras (…, 3, 3) with other focal lengths (…) in pixels, means of both axes."""
    ratio = focal / ((intrinsics[..., 0, 0] + intrinsics[..., 1, 1]) / 2)
    changed = intrinsics.expand(*ratio.shape, 3, 3).clone()
    changed[..., :2, :2] *= ratio[..., None, None]
    return changed


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


def focal_by_distance(distance: Tensor, unit_fraction: float = UNIT_FRACTION) -> Tensor:
    """Focal length over the picture's width at which an object fills the picture as it does at any distance.

    φ = u · √(d² − 1/4): a sphere of diameter 1, which holds an object whose box diagonal is 1, has a silhouette of
    diameter 1 / √(d² − 1/4) times the focal length, so that spans the share u of the width.

    Args:
        distance: d of the camera from the object's centre, in box diagonals, above 1/2.
        unit_fraction: u.

    >>> float(focal_by_distance(torch.tensor(1.3), 1.0))
    1.2000000476837158
    """
    return unit_fraction * (distance.square() - 0.25).sqrt()


def distance_by_focal(focal: Tensor, unit_fraction: float = UNIT_FRACTION) -> Tensor:
    """The inverse of `focal_by_distance`, d = √(1/4 + (φ / u)²).

    In a picture of an object at another scale, φ is the focal length over the picture's width and over that scale.

    >>> float(distance_by_focal(torch.tensor(1.2), 1.0))
    1.2999999523162842
    """
    return (0.25 + (focal / unit_fraction).square()).sqrt()


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
    axis, and R = R_ray · diag(1, −1, −1) · Rz(roll) Rx(elevation) Ry(azimuth). About this ray a small angle spans
    f / cos²θ photo pixels along the radius and f / cos θ across it: as a similarity has one scale, their geometric
    mean. In the photo, the object's bounding sphere spans scale · unit_fraction · side pixels, hence by
    `distance_by_focal`, with D the diagonal,

        t = D · √(1/4 + (f / (scale · unit_fraction · side · cos^{3/2} θ))²),    translation = t · ray.

    Off the axis the photo is stretched, which no similarity can follow: by 1 / cos θ, that is 2 % at 10° and 10 % at
    25°.

    Args:
        azimuth, elevation, roll: (N,) in radians.
        shift: (N, 2) right and up, in half-widths of the picture.
        scale: (N,) above 0.
        crop: the square that was fitted.
        intrinsics: (3, 3) or (N, 3, 3) of the photo.
        diagonal: of the object's bounding box in metres, a number or (N,).
        unit_fraction: share of the picture's width that the bounding sphere's silhouette spans, at scale 1.

    Returns:
        rotation (N, 3, 3) and translation (N, 3) in metres: object to camera, OpenCV axes.
    """
    offset = shift * shift.new_tensor([crop.side / 2, -crop.side / 2])
    pixel = offset + shift.new_tensor(crop.centre)
    rotation = viewing_ray_rotation(pixel, intrinsics) @ to_opencv(rotation_from_angles(azimuth, elevation, roll))
    ray = viewing_ray(pixel, intrinsics)
    focal = (intrinsics[..., 0, 0] + intrinsics[..., 1, 1]).to(shift) / 2
    distance = diagonal * distance_by_focal(focal / (scale * crop.side * ray[..., 2] ** 1.5), unit_fraction)
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


def observed(crop: Crop, image: Any, mask: Any, depth: Any | None, intrinsics: Tensor) -> Observation:
    """What `Crop.cut` gives, with the crop's camera and, where there is depth (H, W), that along the ray of its middle.

    Errors are those of `Crop.cut`.
    """
    along = None if depth is None else depth_along(torch.as_tensor(depth), torch.tensor(crop.centre), intrinsics)
    return replace(crop.cut(image, mask, along), intrinsics=(crop.image_to_crop @ intrinsics).float()[None])
