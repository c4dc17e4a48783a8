"""The observation of an object in a square crop of a photo, with the crop's camera and depth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from kfit.core import Observation
from kfit.geometry.camera import viewing_ray
from kfit.geometry.crop import Crop


def depth_along(depth: Tensor, pixel: Tensor, intrinsics: Tensor) -> Tensor:
    """Convert depth (H, W) along the photo's axis to depth along the ray through a pixel (2,), both in metres.

    d = z · r · K⁻¹ (u, v, 1) with r the ray's unit direction.

    Example:
        >>> import torch
        >>> from kfit.geometry import depth_along, intrinsics_from_fov
        >>> depth_along(torch.ones(3, 3), torch.tensor([1.0, 1.0]), intrinsics_from_fov(3, 3))[1]
        tensor([1., 1., 1.])
    """
    height, width = depth.shape
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    points = torch.linalg.solve(intrinsics, torch.stack([u, v, torch.ones_like(u)]).flatten(1).to(intrinsics))
    along: Tensor = depth * (viewing_ray(pixel.to(intrinsics), intrinsics) @ points).view(height, width).to(depth)
    return along


def observed(crop: Crop, image: Any, mask: Any, depth: Any | None, intrinsics: Tensor) -> Observation:
    """Return the observation of `Crop.cut` with the crop's camera; depth (H, W) becomes depth along its middle ray.

    Raises:
        TypeError, ValueError: as `Crop.cut`.

    Example:
        >>> import torch
        >>> from kfit.geometry import Crop, intrinsics_from_fov, observed
        >>> mask = torch.zeros(480, 640)
        >>> mask[200:280, 300:400] = 1
        >>> photo, camera = torch.rand(480, 640, 3), intrinsics_from_fov(640, 480)
        >>> observation = observed(Crop.around(mask), photo, mask, None, camera)
        >>> observation.image.shape, observation.intrinsics.shape
        (torch.Size([1, 3, 64, 64]), torch.Size([1, 3, 3]))
    """
    along = None if depth is None else depth_along(torch.as_tensor(depth), torch.tensor(crop.centre), intrinsics)
    return replace(crop.cut(image, mask, along), intrinsics=(crop.image_to_crop @ intrinsics.double()).float()[None])
