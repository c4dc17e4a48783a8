"""Any generator's object before several cameras at once."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from kfit.core import Generator, Observation, Positive, Rendering, Variable
from kfit.core.check import check_count, check_range
from kfit.geometry import (
    angles_from_rotation,
    from_opencv,
    rotation_from_angles,
    to_opencv,
    viewing_ray,
    viewing_ray_rotation,
)

PLACING = ("azimuth", "elevation", "roll", "shift", "scale")


class MultiView(Generator):
    """Draws a generator's object as V cameras see it that stand at known poses to one another.

    Azimuth, elevation, roll, shift and scale are those of the reference view, the first. By the views' intrinsics and
    the object's ``diagonal`` D they give its pose there, R and t in metres, as `kfit.geometry.pose_from_crop` says;
    view v sees it at R_v R and R_v t + t_v, with ``trans_cam_ref`` = [R_v | t_v], and that pose gives the angles, shift
    and scale by which the generator draws view v. So the baseline of the cameras fixes the object's distance and size.

    Adds the variable ``diagonal`` (metres, above 0).

    Args:
        generator: with these five variables, as `kfit.generators.SimilarityWarp` around a category's generator.
        image_size: side S of its pictures.
        unit_fraction: share of the picture's width that a unit diagonal spans at scale 1.

    Raises:
        ValueError: if the generator lacks one of the variables, and in a fit without intrinsics or ``trans_cam_ref``.
    """

    def __init__(self, generator: Generator, image_size: int, unit_fraction: float) -> None:
        super().__init__()
        if missing := [name for name in PLACING if name not in generator.variables]:
            raise ValueError(f"MultiView: the generator must have {', '.join(PLACING)}; it lacks {', '.join(missing)}")
        check_count("MultiView: image_size", image_size, 1, 4096)
        check_range("MultiView: unit_fraction", unit_fraction, 0.1, 10.0)
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
        """Draw N · V pictures, the V of a row one after another."""
        cameras, poses = values["intrinsics"], values["trans_cam_ref"]
        views = cameras.shape[1]
        inner = {k: v.repeat_interleave(views, 0) for k, v in values.items() if k in self.generator.variables}
        with torch.autocast(cameras.device.type, enabled=False):
            rotation, translation = self._pose(values, cameras[:, 0])
            turned = poses[..., :3, :3].to(rotation) @ rotation[:, None]
            moved = (poses[..., :3, :3].to(rotation) @ translation[:, None, :, None])[..., 0] + poses[..., :3, 3]
            diagonal = values["diagonal"].repeat_interleave(views, 0)
            inner |= self._seen(turned.flatten(0, 1), moved.flatten(0, 1), cameras.flatten(0, 1), diagonal)
        drawn: Rendering = self.generator(**inner)
        return drawn

    def _pose(self, values: Mapping[str, Tensor], camera: Tensor) -> tuple[Tensor, Tensor]:
        """Rotation (N, 3, 3) and translation (N, 3) in the reference camera, OpenCV axes, metres."""
        shift = values["shift"]
        pixel = (self.image_size - 1) / 2 + shift * shift.new_tensor([1.0, -1.0]) * self.image_size / 2
        camera = camera.to(shift)
        turn = rotation_from_angles(values["azimuth"], values["elevation"], values["roll"])
        rotation = viewing_ray_rotation(pixel, camera) @ to_opencv(turn)
        ray = viewing_ray(pixel, camera)
        return rotation, (values["diagonal"] / (values["scale"] * self._width(camera, ray)))[:, None] * ray

    def _seen(self, rotation: Tensor, translation: Tensor, camera: Tensor, diagonal: Tensor) -> dict[str, Tensor]:
        """Angles, shift and scale by which an object at a pose is drawn: the inverse of `_pose`."""
        camera = camera.to(rotation)
        # An object beside or behind a camera is drawn far outside its picture.
        z = translation[:, 2].clamp_min(1e-3)
        point = torch.cat([translation[:, :2] / z[:, None], torch.ones_like(z)[:, None]], 1)
        pixel = (camera[:, :2] @ point[..., None])[..., 0]
        azimuth, elevation, roll = angles_from_rotation(from_opencv(viewing_ray_rotation(pixel, camera).mT @ rotation))
        distance = translation.norm(dim=1).clamp_min(1e-3)
        flip = pixel.new_tensor([1.0, -1.0])
        return {
            "azimuth": azimuth,
            "elevation": elevation,
            "roll": roll,
            "shift": (pixel - (self.image_size - 1) / 2) * flip / (self.image_size / 2),
            "scale": diagonal / (distance * self._width(camera, viewing_ray(pixel, camera))),
        }

    def _width(self, camera: Tensor, ray: Tensor) -> Tensor:
        """(N,) diagonals per metre of distance that the whole picture's unit spans along a ray, at scale 1."""
        focal = (camera[:, 0, 0] + camera[:, 1, 1]) / 2
        return self.unit_fraction * self.image_size * ray[:, 2] ** 1.5 / focal
