"""A soft renderer of a known mesh through one or several calibrated cameras."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.core import SO3, Generator, Observation, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.generators.splat import DEPTH_SOFTNESS, SurfacePoints


class MeshInCamera(Generator):
    """Draw RGB, mask and depth of a known textured mesh through pinhole cameras, softly, as `MeshRenderer` does.

    A point p of the mesh lies at R p + t in the reference camera (OpenCV: x right, y down, z forward), and projects to
    the pixel K (R p + t) / z. If an observation has several views, view v sees it at R_v (R p + t) + t_v, with
    ``trans_cam_ref`` = [R_v | t_v], and the V pictures of a row are drawn consecutively. Points nearer to the camera's
    plane than 0.01 of the object's box diagonal are not drawn.

    Variables: ``rotation`` R, (3, 3) in SO(3), and ``translation`` t, (3,), in the unit of the vertices.
    Depth is along the camera's axis, in that unit too, as a depth camera measures it.

    Args:
        vertices: (V, 3), in metres for poses in metres.
        faces: (F, 3) vertex numbers.
        uv: (V, 2) column and row in the texture, from its upper left corner, in [0, 1].
        texture: (Ht, Wt, 3) RGB, uint8 or floating point in [0, 1].
        image_size: (H, W).
        intrinsics: (3, 3), pixels with centres at integers; an observation's own intrinsics take precedence.
        num_points: P; about 4 for each pixel that the object covers leave few holes.

    Raises:
        ValueError: if an array has another shape, the surface has no area and, in a fit, if neither the generator nor
            the observation has intrinsics, or several views have no ``trans_cam_ref``.

    Example:
        >>> import torch
        >>> from kfit.generators import MeshInCamera
        >>> from kfit.geometry import intrinsics_from_fov
        >>> corners = torch.tensor([[-0.1, 0.1, 0.0], [0.1, 0.1, 0.0], [0.0, -0.1, 0.0]])
        >>> camera, black = intrinsics_from_fov(64, 48), torch.zeros(1, 1, 3)
        >>> mesh = MeshInCamera(corners, [[0, 1, 2]], torch.zeros(3, 2), black, (48, 64), camera, num_points=2048)
        >>> drawn = mesh(rotation=torch.eye(3)[None], translation=torch.tensor([[0.0, 0.0, 0.5]]))
        >>> drawn.image.shape, drawn.depth[0, 0, 24, 32].round(decimals=2)
        (torch.Size([1, 3, 48, 64]), tensor(0.5000))
    """

    camera: Tensor | None
    centre: Tensor

    def __init__(
        self,
        vertices: Any,
        faces: Any,
        uv: Any,
        texture: Any,
        image_size: tuple[int, int],
        intrinsics: Any = None,
        num_points: int = 8192,
    ) -> None:
        super().__init__()
        check_arguments(MeshInCamera, locals())
        self.variables = {"rotation": Variable((3, 3), SO3()), "translation": Variable((3,))}
        self.image_size = (image_size[0], image_size[1])
        self.surface = SurfacePoints("MeshInCamera", vertices, faces, uv, texture, num_points)
        points = self.surface.points
        low, high = points.amin(0), points.amax(0)
        self.diagonal = float((high - low).norm())
        self.register_buffer("centre", (low + high) / 2, persistent=False)
        if intrinsics is not None:
            intrinsics = torch.as_tensor(intrinsics, dtype=torch.float32)
            check_shape("MeshInCamera: intrinsics", intrinsics, (3, 3))
        self.register_buffer("camera", intrinsics)

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        context, views = {}, observation.views
        if observation.intrinsics is not None:
            context["intrinsics"] = observation.intrinsics.unflatten(0, (-1, views))
        elif self.camera is None:
            raise ValueError("MeshInCamera: the observation has no intrinsics, and none were given to the generator")
        if observation.trans_cam_ref is not None:
            context["trans_cam_ref"] = observation.trans_cam_ref.unflatten(0, (-1, views))
        elif views > 1:
            raise ValueError(f"MeshInCamera: an observation of {views} views must have trans_cam_ref")
        return context

    def forward(self, **values: Tensor) -> Rendering:
        """Draw N rows or, with (N, V, …) ``intrinsics`` and ``trans_cam_ref``, the N · V pictures of V views."""
        rotation, translation = values["rotation"], values["translation"]
        with torch.autocast(rotation.device.type, enabled=False):
            if "trans_cam_ref" in values:
                pose = values["trans_cam_ref"].to(rotation)
                rotation, translation = rotation[:, None], translation[:, None, :, None]
                translation = (pose[..., :3, :3] @ translation + pose[..., :3, 3:])[..., 0].flatten(0, 1)
                rotation = (pose[..., :3, :3] @ rotation).flatten(0, 1)
            cameras = values.get("intrinsics")
            if cameras is None:
                if self.camera is None:
                    raise ValueError("MeshInCamera: it needs intrinsics, its own or those to draw with")
                cameras = self.camera.expand(len(rotation), 3, 3)
            return self._draw(rotation, translation, cameras.reshape(-1, 3, 3).to(rotation))

    def _draw(self, rotation: Tensor, translation: Tensor, cameras: Tensor) -> Rendering:
        placed = self.surface.points @ rotation.mT + translation[:, None]
        facing = ((self.surface.normals @ rotation.mT) * F.normalize(placed, dim=-1)).sum(-1).abs()
        depth = placed[..., 2]
        # Relative to the object's centre, because exponentials of absolute depths would overflow.
        middle = (rotation[:, 2] @ self.centre + translation[:, 2])[:, None]
        before = depth > 0.01 * self.diagonal
        z = depth.where(before, 1.0)
        column, row, _ = (placed @ cameras.mT).unbind(-1)
        # At an angle θ off the axis a surface is farther than z, and stretched by the projection to the picture plane.
        oblique = placed.norm(dim=-1) / z
        focal = (cameras[:, 0, 0] * cameras[:, 1, 1])[:, None]
        area = facing * self.surface.share * focal * oblique / z.square()
        drawn = self.surface.splat(
            (column / z).where(before, -1e4),
            (row / z).where(before, -1e4),
            depth - middle,
            area.where(before, 0.0),
            self.image_size,
            DEPTH_SOFTNESS * self.diagonal,
        )
        assert drawn.depth is not None  # splat always draws depth
        return Rendering(drawn.image, drawn.mask, drawn.depth + middle.view(-1, 1, 1, 1))
