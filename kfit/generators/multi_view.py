"""A generator's object seen by several calibrated cameras at once."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from kfit.core import Generator, Observation, Positive, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.geometry import (
    Crop,
    angles_from_rotation,
    focal_by_distance,
    from_opencv,
    pose_from_crop,
    viewing_ray,
    viewing_ray_rotation,
    with_focal,
)

# Objects nearer to a camera than this many diagonals are drawn at this distance.
NEAREST = 0.6
PLACING = ("azimuth", "elevation", "roll", "shift", "scale")


class MultiView(Generator):
    """Draw a generator's object as seen by V cameras with known relative poses.

    Azimuth, elevation, roll, shift and scale are those of the reference view, the first one. With the views' intrinsics
    and the object's ``diagonal`` D they determine its pose there, R and t in metres, by `kfit.geometry.pose_from_crop`.
    View v sees it at R_v R and R_v t + t_v, with ``trans_cam_ref`` = [R_v | t_v], and that pose determines the angles,
    shift and scale with which the generator draws view v. The baseline of the cameras thus determines the object's
    distance and size. A generator's ``focal``, the focal length over the picture's width, is that of the reference view
    too; the ratios of the others to it follow from the intrinsics.

    Adds the variable ``diagonal`` (metres, above 0).

    Args:
        generator: with these five variables, as `kfit.generators.SimilarityWarp` around a category's generator.
        image_size: side S of its pictures.
        unit_fraction: fraction of the picture's width that the bounding sphere's silhouette spans at scale 1.

    Raises:
        ValueError: if the generator lacks one of the variables and, in a fit, if the observation has no intrinsics or
            no ``trans_cam_ref``.

    Example:
        >>> from kfit.generators import VAE2D, MultiView, SimilarityWarp
        >>> generator = MultiView(SimilarityWarp(VAE2D()), image_size=64, unit_fraction=1.0)
        >>> sorted(generator.variables)
        ['azimuth', 'code', 'diagonal', 'elevation', 'roll', 'scale', 'shift']
    """

    def __init__(self, generator: Generator, image_size: int, unit_fraction: float) -> None:
        super().__init__()
        if missing := [name for name in PLACING if name not in generator.variables]:
            raise ValueError(f"MultiView: the generator must have {', '.join(PLACING)}; it lacks {', '.join(missing)}")
        check_arguments(MultiView, locals(), unit_fraction=(0.1, 10.0))
        self.generator, self.image_size, self.unit_fraction = generator, image_size, unit_fraction
        self.variables = {**generator.variables, "diagonal": Variable((), Positive())}

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        if observation.intrinsics is None or observation.trans_cam_ref is None:
            raise ValueError("MultiView: the observation must have intrinsics and trans_cam_ref")
        views = observation.views
        return {
            "intrinsics": observation.intrinsics.unflatten(0, (-1, views)),
            "trans_cam_ref": observation.trans_cam_ref.unflatten(0, (-1, views)),
        }

    def forward(self, **values: Tensor) -> Rendering:
        """Draw N · V pictures, the V of a row consecutively."""
        cameras, poses = values["intrinsics"], values["trans_cam_ref"]
        views = cameras.shape[1]
        inner = {k: v.repeat_interleave(views, 0) for k, v in values.items() if k in self.generator.variables}
        with torch.autocast(cameras.device.type, enabled=False):
            cameras, poses = cameras.to(values["diagonal"]), poses.to(values["diagonal"])
            if "focal" in values:
                by_camera = _focal(cameras) / self.image_size
                focal = by_camera * (values["focal"] / by_camera[:, 0])[:, None]
                cameras, inner["focal"] = with_focal(cameras, focal * self.image_size), focal.flatten()
            rotation, translation = self._pose(values, cameras[:, 0])
            rotations = poses[..., :3, :3] @ rotation[:, None]
            moved = (poses[..., :3, :3] @ translation[:, None, :, None])[..., 0] + poses[..., :3, 3]
            diagonal = values["diagonal"].repeat_interleave(views, 0)
            inner |= self._in_view(rotations.flatten(0, 1), moved.flatten(0, 1), cameras.flatten(0, 1), diagonal)
        drawn: Rendering = self.generator(**inner)
        return drawn

    def _pose(self, values: Mapping[str, Tensor], camera: Tensor) -> tuple[Tensor, Tensor]:
        """Return rotation (N, 3, 3) and translation (N, 3) in the reference camera, OpenCV axes, metres."""
        middle = (self.image_size - 1) / 2
        crop = Crop((middle, middle), float(self.image_size), self.image_size)
        azimuth, elevation, roll, shift, scale = (values[name] for name in PLACING)
        return pose_from_crop(
            azimuth, elevation, roll, shift, scale, crop, camera, values["diagonal"], self.unit_fraction
        )

    def _in_view(self, rotation: Tensor, translation: Tensor, camera: Tensor, diagonal: Tensor) -> dict[str, Tensor]:
        """Return angles, shift and scale that draw an object at a pose: the inverse of `_pose`."""
        # Objects at the side of a camera or behind it are drawn far outside of its picture.
        z = translation[:, 2].clamp_min(1e-3)
        point = torch.cat([translation[:, :2] / z[:, None], torch.ones_like(z)[:, None]], 1)
        pixel = (camera[:, :2] @ point[..., None])[..., 0]
        azimuth, elevation, roll = angles_from_rotation(from_opencv(viewing_ray_rotation(pixel, camera).mT @ rotation))
        # The focal length over the picture's width and over the scale.
        near = focal_by_distance((translation.norm(dim=1) / diagonal).clamp_min(NEAREST), self.unit_fraction)
        ahead = viewing_ray(pixel, camera)[:, 2] ** 1.5
        return {
            "azimuth": azimuth,
            "elevation": elevation,
            "roll": roll,
            "shift": (pixel - (self.image_size - 1) / 2) * pixel.new_tensor([2.0, -2.0]) / self.image_size,
            "scale": _focal(camera) / (self.image_size * ahead * near),
        }


def _focal(cameras: Tensor) -> Tensor:
    """Return focal lengths (…) in pixels, means of both axes, of cameras (…, 3, 3)."""
    return (cameras[..., 0, 0] + cameras[..., 1, 1]) / 2
