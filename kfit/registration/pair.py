"""Two batches of pictures on one frame, and their pyramid."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from kornia.filters import gaussian_blur2d
from torch import Tensor

from kfit.core.check import check_float, check_shape

# The coarsest picture's shorter side, in pixels; few enough that many starts cost little.
LEAST_SIDE = 24


@dataclass(frozen=True)
class Pair:
    """Pictures of one size with masks, (B, …)."""

    moving: Tensor
    fixed: Tensor
    moving_mask: Tensor
    fixed_mask: Tensor

    @property
    def size(self) -> tuple[int, int]:
        return self.fixed.shape[-2], self.fixed.shape[-1]

    def at(self, shrink: int, blur: float) -> Pair:
        """A level of the pyramid, blurred: what is finer than pixels came down into both pictures differently.

        Blur spoils the outermost pixels, which do not count there.
        """
        size = [max(2, round(side / shrink)) for side in self.size]
        inner = F.pad(self.fixed.new_ones(1, 1, size[0] - 2, size[1] - 2), [1] * 4)
        parts = []
        for picture, mask in ((self.moving, self.moving_mask), (self.fixed, self.fixed_mask)):
            known = F.interpolate(mask, size, mode="area")
            seen = F.interpolate(picture * mask, size, mode="area") / known.clamp_min(1e-6)
            # Unknown pixels get the mean, so that blur brings in no edge of theirs.
            mean = (seen * known).sum((2, 3), keepdim=True) / known.sum((2, 3), keepdim=True).clamp_min(1e-6)
            seen = torch.where(known > 0.5, seen, mean)
            whole = (known > 0.999).to(known) if blur else known
            parts.append((gaussian_blur2d(seen, (7, 7), (blur, blur)), whole * inner))
        (moving, moving_mask), (fixed, fixed_mask) = parts
        return Pair(moving, fixed, moving_mask, fixed_mask)


def pyramid_levels(size: tuple[int, int]) -> list[int]:
    """How much smaller each level is, from the coarsest on."""
    shrinks = [1]
    while min(size) / (2 * shrinks[-1]) >= LEAST_SIDE:
        shrinks.append(2 * shrinks[-1])
    return shrinks[::-1]


def checked_pair(moving: Tensor, fixed: Tensor, moving_mask: Tensor | None, fixed_mask: Tensor | None) -> Pair:
    """Pictures and masks on one frame, which holds both from its upper left corner on."""
    parts = {}
    for name, picture, mask in (("moving", moving, moving_mask), ("fixed", fixed, fixed_mask)):
        if isinstance(picture, Tensor) and picture.dim() == 3:
            picture, mask = picture[None], None if mask is None else mask.view(1, *mask.shape[-3:])
        check_shape(name, picture, ("B", "C", "H", "W"))
        check_float(name, picture)
        if min(picture.shape) < 1 or min(picture.shape[-2:]) < 8:
            raise ValueError(f"{name} must hold pictures of at least 8 × 8 pixels, got shape {tuple(picture.shape)}")
        if mask is None:
            mask = torch.ones_like(picture[:, :1])
        check_shape(f"{name}_mask", mask, (len(picture), 1, *picture.shape[-2:]))
        parts[name] = (picture.detach(), mask.detach().to(picture))
    (a, a_mask), (b, b_mask) = parts["moving"], parts["fixed"]
    if a.shape[:2] != b.shape[:2]:
        raise ValueError(
            f"moving and fixed must agree in number and channels, got {tuple(a.shape)} and {tuple(b.shape)}"
        )
    size = [max(sides) for sides in zip(a.shape[-2:], b.shape[-2:], strict=True)]
    padded = [F.pad(x, (0, size[1] - x.shape[-1], 0, size[0] - x.shape[-2])) for x in (a, b, a_mask, b_mask)]
    return Pair(*padded)
