"""The corruptions of the paper's robustness study: occlusion, brightness and shift."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core import Rendering
from kfit.core.arguments import check_arguments
from kfit.generators.similarity_warp import warp


class RandomCorruption:
    """Occlude a part of objects, change their brightness and shift them, each at random up to a range.

    The defaults are those of the paper's regressor (Chen et al. 2020, section 4.3): occluded fractions are uniform in
    [0, ``occlusion``], factors of brightness uniform in 1 ± ``brightness``, and shifts have any direction and a length
    uniform in [0, ``shift``].

    Args:
        occlusion: largest occluded fraction of the object, see ``occluded``.
        brightness: largest change of the factor of brightness, see ``brightened``.
        shift: largest shift as a fraction of the picture's width, see ``shifted``.

    Raises:
        ValueError: if a range is outside [0, 1].
    """

    def __init__(self, occlusion: float = 0.2, brightness: float = 0.4, shift: float = 0.25) -> None:
        check_arguments(RandomCorruption, locals(), occlusion=(0, 1), brightness=(0, 1), shift=(0, 1))
        self.occlusion, self.brightness, self.shift = occlusion, brightness, shift

    def __call__(self, image: Tensor, mask: Tensor, rng: torch.Generator | None = None) -> tuple[Tensor, Tensor]:
        """Pictures (N, 3, S, S) on white and masks (N, 1, S, S) → the same, each picture its own way.

        Random numbers are torch's, or those of ``rng``.
        """
        hidden, bright, length, turn = _even((4, len(image)), image, rng)
        image, mask = occluded(image, mask, self.occlusion * hidden, rng)
        image = brightened(image, mask, 1 + self.brightness * (2 * bright - 1))
        angle = 2 * math.pi * turn
        offset = (self.shift * length)[:, None] * torch.stack([angle.cos(), angle.sin()], 1)
        return shifted(image, mask, offset)


def occluded(
    image: Tensor, mask: Tensor, share: float | Tensor, rng: torch.Generator | None = None
) -> tuple[Tensor, Tensor]:
    """Hide a fraction of each object behind a square that is white, like pixels outside of a mask.

    The square is centred at a random pixel of the object, and its size hides this fraction of the mask, to a pixel.

    Args:
        image: (N, 3, H, W) on white.
        mask: (N, 1, H, W) in [0, 1].
        share: share of the mask's sum, in [0, 1], a number or (N,).
        rng: for the pixels; by default torch's.

    Returns:
        Pictures and masks without the hidden parts.
    """
    height, width = mask.shape[-2:]
    weight = mask.flatten(1)
    total = weight.sum(1, keepdim=True)
    # The pixel at which the cumulative sum of the mask, row by row, reaches a uniformly random fraction.
    drawn = _even((len(mask), 1), mask, rng) * total
    centre = torch.searchsorted(weight.cumsum(1), drawn).clamp(max=height * width - 1)
    place = torch.arange(height * width, device=mask.device)
    down, across = (place // width - centre // width).abs(), (place % width - centre % width).abs()
    # By the larger of the two, which makes squares; the smaller one grows them evenly from the middles of their sides.
    order = (torch.maximum(down, across) * (height + width) + torch.minimum(down, across)).argsort(dim=1, stable=True)
    wanted = torch.as_tensor(share, dtype=mask.dtype, device=mask.device).expand(len(mask))[:, None] * total
    gathered = weight.gather(1, order).cumsum(1)
    # Half a pixel's tolerance, so that none and all of the object are exactly that.
    gone = (gathered - weight.gather(1, order) / 2 < wanted) & (wanted > 0)
    kept = torch.ones_like(weight).scatter(1, order, 1 - gone.to(weight.dtype)).view_as(mask)
    return (image - 1) * kept + 1, mask * kept


def brightened(image: Tensor, mask: Tensor, factor: float | Tensor) -> Tensor:
    """Multiply the light on each object, as a longer exposure would; the background stays white.

    With object colour c and mask m, a pixel m c + 1 − m becomes m · min(f c, 1) + 1 − m.

    Args:
        image: (N, 3, H, W) on white.
        mask: (N, 1, H, W) in [0, 1].
        factor: f, 0 or above, a number or (N,).
    """
    gain = torch.as_tensor(factor, dtype=image.dtype, device=image.device).expand(len(image))[:, None, None, None]
    ground = 1 - mask
    return torch.minimum(gain * (image - ground).clamp_min(0), mask) + ground


def shifted(image: Tensor, mask: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    """Shift pictures and masks; the outside is white.

    Args:
        image: (N, 3, S, S) on white.
        mask: (N, 1, S, S) in [0, 1].
        offset: (N, 2) right and up, as fractions of the picture's width.
    """
    rows = len(image)
    moved = warp(Rendering(image, mask), image.new_zeros(rows), 2 * offset.to(image), image.new_ones(rows))
    assert moved.mask is not None
    return moved.image, moved.mask


def _even(shape: tuple[int, ...], like: Tensor, rng: torch.Generator | None) -> Tensor:
    return torch.rand(shape, generator=rng, device=like.device, dtype=like.dtype)
