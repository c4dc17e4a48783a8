"""Two batches of pictures or volumes, padded to one size, and their pyramid."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from kornia.filters import filter3d, gaussian_blur2d, get_gaussian_kernel3d
from torch import Tensor

from kfit.core.check import check_float, check_shape

# The shortest side of the coarsest picture and of the coarsest volume, in pixels; small, so that many starts are cheap.
LEAST_SIDE, LEAST_VOLUME_SIDE = 24, 12


@dataclass(frozen=True)
class Pair:
    """Pictures or volumes of one size with masks, (B, …)."""

    moving: Tensor
    fixed: Tensor
    moving_mask: Tensor
    fixed_mask: Tensor

    @property
    def size(self) -> tuple[int, ...]:
        return tuple(self.fixed.shape[2:])

    def at(self, shrink: int, blur: float) -> Pair:
        """Return a blurred level of the pyramid, as details finer than pixels are sampled differently in each picture.

        Blur corrupts the outermost pixels, which get weight 0.
        """
        size = [max(2, round(side / shrink)) for side in self.size]
        inner = F.pad(self.fixed.new_ones(1, 1, *[side - 2 for side in size]), [1] * 2 * len(size))
        axes = tuple(range(2, 2 + len(size)))
        parts = []
        for picture, mask in ((self.moving, self.moving_mask), (self.fixed, self.fixed_mask)):
            known = F.interpolate(mask, size, mode="area")
            observed = F.interpolate(picture * mask, size, mode="area") / known.clamp_min(1e-6)
            # Unknown pixels get the mean, so that blurring adds no edges at their borders.
            mean = (observed * known).sum(axes, keepdim=True) / known.sum(axes, keepdim=True).clamp_min(1e-6)
            observed = torch.where(known > 0.5, observed, mean)
            whole = (known > 0.999).to(known) if blur else known
            parts.append((_blurred(observed, blur), whole * inner))
        (moving, moving_mask), (fixed, fixed_mask) = parts
        return Pair(moving, fixed, moving_mask, fixed_mask)


def _blurred(pictures: Tensor, sigma: float) -> Tensor:
    """Blur pictures or volumes by a Gaussian."""
    if pictures.dim() == 4:
        flat: Tensor = gaussian_blur2d(pictures, (7, 7), (sigma, sigma))
        return flat
    deep: Tensor = filter3d(pictures, get_gaussian_kernel3d((7, 7, 7), (sigma, sigma, sigma)).to(pictures))
    return deep


def pyramid_levels(size: tuple[int, ...]) -> list[int]:
    """Return the reduction factor of each level, the coarsest first."""
    shrinks = [1]
    while min(size) / (2 * shrinks[-1]) >= (LEAST_SIDE if len(size) == 2 else LEAST_VOLUME_SIDE):
        shrinks.append(2 * shrinks[-1])
    return shrinks[::-1]


def checked_pair(moving: Tensor, fixed: Tensor, moving_mask: Tensor | None, fixed_mask: Tensor | None) -> Pair:
    """Check pictures or volumes and masks, and pad them at the ends of their axes to one size."""
    parts = {}
    volumes = isinstance(moving, Tensor) and moving.dim() == 5
    axes = tuple("DHW" if volumes else "HW")
    for name, picture, mask in (("moving", moving, moving_mask), ("fixed", fixed, fixed_mask)):
        if isinstance(picture, Tensor) and picture.dim() == 3:
            picture, mask = picture[None], None if mask is None else mask.view(1, *mask.shape[-3:])
        check_shape(name, picture, ("B", "C", *axes))
        check_float(name, picture)
        if min(picture.shape) < 1 or min(picture.shape[2:]) < 8:
            least = "volumes of at least 8 × 8 × 8 voxels" if volumes else "pictures of at least 8 × 8 pixels"
            raise ValueError(f"{name} must hold {least}, got shape {tuple(picture.shape)}")
        if mask is None:
            mask = torch.ones_like(picture[:, :1])
        check_shape(f"{name}_mask", mask, (len(picture), 1, *picture.shape[2:]))
        parts[name] = (picture.detach(), mask.detach().to(picture))
    (a, a_mask), (b, b_mask) = parts["moving"], parts["fixed"]
    if a.shape[:2] != b.shape[:2]:
        raise ValueError(
            f"moving and fixed must agree in number and channels, got {tuple(a.shape)} and {tuple(b.shape)}"
        )
    size = [max(sides) for sides in zip(a.shape[2:], b.shape[2:], strict=True)]
    return Pair(*(_padded(x, size) for x in (a, b, a_mask, b_mask)))


def _padded(pictures: Tensor, size: list[int]) -> Tensor:
    """Pad pictures or volumes with zeros at the end of each axis, up to ``size``."""
    missing = [to - side for to, side in zip(size, pictures.shape[2:], strict=True)]
    return F.pad(pictures, [number for side in missing[::-1] for number in (0, side)])
