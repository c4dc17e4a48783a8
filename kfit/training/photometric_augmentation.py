"""Photometric augmentation: camera, light, and inexact masks."""

from __future__ import annotations

import torch
from kornia.filters import gaussian_blur2d
from torch import Tensor

from kfit.core.arguments import check_arguments


class PhotometricAugmentation:
    """Make clean views resemble photos: cast, exposure, blur, noise, and inexact edges.

    With the object's colour c and its mask m, a picture is

    I' = m' · (m · min(e g ⊙ c, 1) + (1 − m) · b) + 1 − m' + m' · n,

    blurred before it is masked by m': e is the exposure, g the gains of the channels (both log-normal), b a uniform
    colour of the background, n normal noise, and m' the mask blurred by 1 pixel and thresholded at a value that varies
    smoothly over the picture around one half, which adds parts of the background and removes parts of the object. Half
    of the pictures are unchanged, because a generator's views are clean.

    Args:
        exposure: standard deviation of ln e.
        cast: standard deviation of ln g.
        blur: largest standard deviation of the blur, in pixels.
        noise: largest standard deviation of the noise.
        edge: standard deviation of the threshold at which the blurred mask is cut.

    Raises:
        ValueError: if a number is negative, or far beyond real cameras.
    """

    def __init__(
        self, exposure: float = 0.25, cast: float = 0.08, blur: float = 0.8, noise: float = 0.03, edge: float = 0.25
    ) -> None:
        check_arguments(
            PhotometricAugmentation, locals(), exposure=(0, 2), cast=(0, 1), blur=(0, 8), noise=(0, 1), edge=(0, 1)
        )
        self.exposure, self.cast, self.blur, self.noise, self.edge = exposure, cast, blur, noise, edge

    def __call__(self, image: Tensor, mask: Tensor) -> Tensor:
        """Pictures (N, 3, S, S) on white and their masks (N, 1, S, S) → pictures, each its own way, drawn from torch's
        random numbers."""
        return self.with_mask(image, mask)[0]

    def with_mask(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Pictures and masks as ``__call__`` takes them → pictures and the masks m' by which they are cut out."""
        rows, _, height, width = image.shape

        def even(*shape: int) -> Tensor:
            return torch.rand(*shape, device=image.device, dtype=image.dtype)

        def normal(*shape: int) -> Tensor:
            return torch.randn(*shape, device=image.device, dtype=image.dtype)

        light = torch.exp(self.exposure * normal(rows, 1, 1, 1) + self.cast * normal(rows, 3, 1, 1))
        object_part = torch.minimum(light * (image - 1 + mask).clamp_min(0), mask)
        photo = object_part + (1 - mask) * even(rows, 3, 1, 1)
        sigma = (self.blur * even(rows, 1)).clamp_min(1e-2).expand(rows, 2)
        photo = gaussian_blur2d(photo, 5, sigma)
        photo = photo + self.noise * even(rows, 1, 1, 1) * normal(rows, 3, height, width)
        wander = torch.nn.functional.interpolate(
            normal(rows, 1, 8, 8), (height, width), mode="bilinear", align_corners=False
        )
        threshold = (0.5 + self.edge * wander).clamp(0.2, 0.8)  # nothing where no mask is near
        # A ramp of a quarter keeps edges as soft as a picture's own are.
        cut = ((gaussian_blur2d(mask, 5, mask.new_ones(rows, 2)) - threshold) / 0.25 + 0.5).clamp(0, 1)
        shot = photo.clamp(0, 1) * cut + 1 - cut
        clean = even(rows, 1, 1, 1) < 0.5
        return torch.where(clean, image, shot), torch.where(clean, mask, cut)
