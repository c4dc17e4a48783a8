"""Cameras: intrinsics, viewing rays, and the conversion of a fitted crop to a pose in the photo's camera."""

from __future__ import annotations

import math

import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor

from kfit.core.arguments import check_arguments
from kfit.geometry.crop import Crop
from kfit.geometry.pose import rotation_from_angles, to_opencv

# Fraction of the picture's width that the silhouette of the object's bounding sphere spans at scale 1.
UNIT_FRACTION = 0.95


def intrinsics_from_fov(width: int, height: int, fov_deg: float = 60.0) -> Tensor:
    """Return intrinsics of an ideal camera with field of view ``fov_deg`` along the photo's longer side.

    f = max(width, height) / (2 tan(fov / 2)), principal point ((width − 1) / 2, (height − 1) / 2). The default lies
    between a phone's main lens (26 mm on film: 67°) and a normal lens (50 mm: 39°); a wrong angle changes the distance
    in proportion to f and tilts an object off the centre by a few degrees.

    Returns:
        (3, 3), pixels with centres at integers.

    Raises:
        ValueError: if a side is below 1 or the angle not between 1° and 179°.

    Example:
        >>> from kfit.geometry import intrinsics_from_fov
        >>> intrinsics_from_fov(640, 480, fov_deg=90)
        tensor([[320.0000,   0.0000, 319.5000],
                [  0.0000, 320.0000, 239.5000],
                [  0.0000,   0.0000,   1.0000]])
    """
    check_arguments(intrinsics_from_fov, locals(), fov_deg=(1, 179))
    return intrinsics_of(max(width, height) / (2 * math.tan(math.radians(fov_deg) / 2)), width, height)


def with_focal(intrinsics: Tensor, focal: Tensor) -> Tensor:
    """Return the cameras (…, 3, 3) with other focal lengths (…) in pixels, means of both axes.

    Example:
        >>> import torch
        >>> from kfit.geometry import intrinsics_from_fov, with_focal
        >>> with_focal(intrinsics_from_fov(640, 480), torch.tensor(500.0))[0]
        tensor([500.0000,   0.0000, 319.5000])
    """
    ratio = focal / ((intrinsics[..., 0, 0] + intrinsics[..., 1, 1]) / 2)
    changed = intrinsics.expand(*ratio.shape, 3, 3).clone()
    changed[..., :2, :2] *= ratio[..., None, None]
    return changed


def viewing_ray(pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Return the unit direction (…, 3), OpenCV axes, of the ray through a pixel (…, 2); intrinsics (…, 3, 3).

    Example:
        >>> import torch
        >>> from kfit.geometry import intrinsics_from_fov, viewing_ray
        >>> viewing_ray(torch.tensor([319.5, 239.5]), intrinsics_from_fov(640, 480))
        tensor([0., 0., 1.])
    """
    homogeneous = torch.cat((pixel, torch.ones_like(pixel[..., :1])), -1)
    ray = torch.linalg.solve(intrinsics.to(pixel), homogeneous[..., None])[..., 0]
    unit: Tensor = ray / ray.norm(dim=-1, keepdim=True)
    return unit


def viewing_ray_rotation(pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Return the smallest rotation of the optical axis to the ray through a pixel.

    A crop around a pixel off the photo's middle approximates the view of a camera that points at it, so
    R_cam = R_ray · R_crop.

    Args:
        pixel: (…, 2).
        intrinsics: (…, 3, 3).

    Returns:
        (…, 3, 3) in OpenCV axes, whose third column is the ray.

    Example:
        >>> import torch
        >>> from kfit.geometry import intrinsics_from_fov, viewing_ray_rotation
        >>> camera = intrinsics_from_fov(640, 480, fov_deg=90)
        >>> viewing_ray_rotation(torch.tensor([639.5, 239.5]), camera)[:, 2]  # 45° to the right
        tensor([0.7071, 0.0000, 0.7071])
    """
    x, y, z = viewing_ray(pixel, intrinsics).unbind(-1)
    # Unit vectors a and b: the quaternion (1 + a·b, a × b) turns a into b by the shortest way.
    rotation: Tensor = quaternion_to_rotation_matrix(torch.stack((1 + z, -y, x, torch.zeros_like(z)), -1))
    return rotation


def focal_by_distance(distance: Tensor, unit_fraction: float = UNIT_FRACTION) -> Tensor:
    """Return the focal length over the picture's width at which an object keeps its size in the picture.

    φ = u · √(d² − 1/4): the silhouette of a sphere of diameter 1, which holds an object of box diagonal 1, has a
    diameter of 1 / √(d² − 1/4) times the focal length. With this focal length it spans the fraction u of the width.

    Args:
        distance: d of the camera from the object's centre, in box diagonals, above 1/2.
        unit_fraction: u.

    Example:
        >>> import torch
        >>> from kfit.geometry import focal_by_distance
        >>> focal_by_distance(torch.tensor(1.3), 1.0)
        tensor(1.2000)
    """
    return unit_fraction * (distance.square() - 0.25).sqrt()


def distance_by_focal(focal: Tensor, unit_fraction: float = UNIT_FRACTION) -> Tensor:
    """Invert `focal_by_distance`: d = √(1/4 + (φ / u)²).

    For a picture of an object at another scale, φ is the focal length over the picture's width, divided by the scale.

    Example:
        >>> import torch
        >>> from kfit.geometry import distance_by_focal
        >>> distance_by_focal(torch.tensor(1.2), 1.0)
        tensor(1.3000)
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
    """Compute the pose in the photo's camera of an object fitted in a crop of the photo.

    The generator's camera points at the *object's* centre, wherever the shift then moves the picture. The axis of that
    camera is the ray through the pixel p = centre + side / 2 · (shift_x, −shift_y), at an angle θ to the photo's axis,
    and R = R_ray · diag(1, −1, −1) · Rz(roll) Rx(elevation) Ry(azimuth). Around this ray a small angle spans f / cos²θ
    photo pixels along the radius and f / cos θ across it; a similarity has one scale, their geometric mean. In the
    photo, the object's bounding sphere spans scale · unit_fraction · side pixels, hence by `distance_by_focal`, with D
    the diagonal,

        t = D · √(1/4 + (f / (scale · unit_fraction · side · cos^{3/2} θ))²),    translation = t · ray.

    Off the axis the photo is stretched by 1 / cos θ, which no similarity can reproduce: 2 % at 10° and 10 % at 25°.

    Args:
        azimuth, elevation, roll: (N,) in radians.
        shift: (N, 2) right and up, in half-widths of the picture.
        scale: (N,) above 0.
        crop: the fitted square.
        intrinsics: (3, 3) or (N, 3, 3) of the photo.
        diagonal: diagonal of the object's bounding box in metres, a number or (N,).
        unit_fraction: fraction of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Returns:
        rotation (N, 3, 3) and translation (N, 3) in metres: object to camera, OpenCV axes.

    Example:
        >>> import torch
        >>> from kfit.geometry import Crop, intrinsics_from_fov, pose_from_crop
        >>> crop, zero = Crop((319.5, 239.5), side=128), torch.zeros(1)
        >>> camera = intrinsics_from_fov(640, 480)
        >>> rotation, translation = pose_from_crop(
        ...     zero, zero, zero, torch.zeros(1, 2), torch.ones(1), crop, camera, diagonal=0.17
        ... )
        >>> translation  # straight ahead
        tensor([[0.0000, 0.0000, 0.7795]])
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
    """Return the box diagonal (N,) in metres of an object at a known distance (N,) along its ray.

    With this diagonal, `pose_from_crop` places the object at the distance. The other arguments are the same.

    Example:
        >>> import torch
        >>> from kfit.geometry import Crop, diagonal_at, intrinsics_from_fov
        >>> crop, camera = Crop((319.5, 239.5), side=128), intrinsics_from_fov(640, 480)
        >>> diagonal_at(torch.tensor([0.8]), torch.zeros(1, 2), torch.ones(1), crop, camera)
        tensor([0.1745])
    """
    one = torch.ones_like(distance)
    zero = torch.zeros_like(distance)
    _, unit = pose_from_crop(zero, zero, zero, shift, scale, crop, intrinsics, one, unit_fraction)
    diagonal: Tensor = distance / unit.norm(dim=-1)
    return diagonal


def intrinsics_of(focal: float, width: int, height: int) -> Tensor:
    """Return intrinsics (3, 3) of a focal length in pixels, with the principal point at the photo's middle."""
    return torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
