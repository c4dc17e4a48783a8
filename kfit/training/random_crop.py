"""Views cropped like photos: rotated in the plane and framed by the object's outline."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from kornia.geometry.transform import warp_affine
from torch import Tensor

from kfit.core.arguments import check_arguments
from kfit.geometry.crop import MARGIN
from kfit.training.random_corruption import occluded


class RandomCrop:
    """Rotate views at random, hide a part of some, and crop them by the box of the visible part.

    A view of a generator shows the object upright, with its box's centre in the middle and a fixed scale. The crop of a
    photo is framed by the mask's box (`kfit.geometry.Crop.around`), and hand-held cameras and lying objects are rolled.
    Half of the rolls are normal around 0, the others uniform over the circle: objects mostly stand, but not always.

    Args:
        size: side of the crops in pixels.
        roll_deg: standard deviation of the rolls around 0.
        shift: largest shift of the crop's centre, as a fraction of its side.
        scale: largest factor on the crop's side; factors are log-uniform between its inverse and itself.
        hidden: probability that a side of the object is hidden, up to 0.4 of its extent, as by a picture's border or
            by another object.
        covered: probability that something in front hides up to 0.4 of the object, anywhere.

    Raises:
        ValueError: if an argument is out of range.
    """

    def __init__(
        self,
        size: int = 64,
        roll_deg: float = 10.0,
        shift: float = 0.04,
        scale: float = 1.1,
        hidden: float = 0.2,
        covered: float = 0.25,
    ) -> None:
        check_arguments(
            RandomCrop, locals(), roll_deg=(0, 180), shift=(0, 0.5), scale=(1, 2), hidden=(0, 1), covered=(0, 1)
        )
        self.size, self.roll, self.shift, self.scale = size, math.radians(roll_deg), shift, scale
        self.hidden, self.covered = hidden, covered

    def __call__(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Crop pictures (N, 3, S, S) on white by their masks (N, 1, S, S).

        Returns:
            Crops (N, 3, size, size) on white, and their rolls (N,) in radians; drawn from torch's random numbers.
        """
        image, _, crop = self.draw(image, mask)
        return crop.cut(image, self.size), crop.roll

    def draw(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, RolledCrop]:
        """Hide parts of pictures (N, 3, S, S) and masks (N, 1, S, S), and choose the crops of what is left."""
        rows = image.new_zeros(len(image))
        near = self.roll * torch.randn_like(rows)
        roll = torch.where(torch.rand_like(rows) < 0.5, near, math.pi * (2 * torch.rand_like(rows) - 1))
        image, mask = self._hide(image, mask)
        even = 2 * torch.rand_like(image[:, :, 0, 0]) - 1
        shift, factor = self.shift * even[:, :2], (math.log(self.scale) * even[:, 2]).exp()
        return image, mask, RolledCrop.around(mask, roll, shift, factor)

    def _hide(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        rows = image.new_zeros(len(image))
        chosen = torch.rand_like(rows) < self.covered
        if chosen.any():
            shown = occluded(image[chosen], mask[chosen], 0.4 * torch.rand_like(rows[chosen]))
            image, mask = image.clone(), mask.clone()
            image[chosen], mask[chosen] = shown
        angle = 2 * math.pi * torch.rand_like(rows)
        share = 0.4 * torch.rand_like(rows) * (torch.rand_like(rows) < self.hidden)
        x, y = _pixels(mask)
        along = angle.cos()[:, None, None] * x + angle.sin()[:, None, None] * y
        there = mask[:, 0] > 0.5
        low, high = (_extreme(along, there, largest) for largest in (False, True))
        kept = (along <= (high - share * (high - low))[:, None, None]).to(image)[:, None]
        return (image - 1) * kept + 1, mask * kept


class RolledCrop(NamedTuple):
    """Squares cut out of pictures that are turned about their middles first.

    Attributes:
        roll: (N,) anticlockwise turns in radians.
        centre: (N, 2) of the squares, in pixels right and down from the middles of the turned pictures.
        side: (N,) of the squares in pixels.
    """

    roll: Tensor
    centre: Tensor
    side: Tensor

    @classmethod
    def around(
        cls, mask: Tensor, roll: Tensor, shift: Tensor | None = None, factor: Tensor | None = None
    ) -> RolledCrop:
        """The squares around the boxes of the turned masks, their sides 1.3 times those of the boxes.

        Args:
            mask: (N, 1, S, S), above 1/2 on the object.
            roll: (N,).
            shift: (N, 2) of the squares' centres right and down, as shares of their sides.
            factor: (N,) on the squares' sides.
        """
        cos, sin = roll.cos()[:, None, None], roll.sin()[:, None, None]
        x, y = _pixels(mask)
        # In pixels y points down: an anticlockwise turn takes (x, y) to (x cos + y sin, −x sin + y cos).
        rotated = torch.stack([cos * x + sin * y, cos * y - sin * x])
        there = mask[:, 0] > 0.5
        low, high = (torch.stack([_extreme(axis, there, largest) for axis in rotated], 1) for largest in (False, True))
        side = MARGIN * (high - low + 1).amax(1)
        side = side if factor is None else side * factor
        centre = (low + high) / 2
        return cls(roll, centre if shift is None else centre + shift * side[:, None], side)

    def cut(self, image: Tensor, size: int) -> Tensor:
        """Pictures (N, C, S, S) on white → the squares as pictures (N, C, size, size) on white."""
        cos, sin = self.roll.cos()[:, None, None], self.roll.sin()[:, None, None]
        zoom = (size / self.side)[:, None, None]
        linear = zoom * torch.cat([torch.cat([cos, sin], 2), torch.cat([-sin, cos], 2)], 1)
        middle_in, middle_out = (image.shape[-1] - 1) / 2, (size - 1) / 2
        offset = middle_out - zoom * self.centre[..., None] - linear.sum(2, keepdim=True) * middle_in
        with torch.autocast(image.device.type, enabled=False):
            matrix = torch.cat([linear, offset], 2)
            cropped: Tensor = warp_affine(image - 1, matrix, (size, size), align_corners=True) + 1
        return cropped


def crop_rolled(image: Tensor, mask: Tensor, roll: Tensor, size: int) -> Tensor:
    """Turn pictures (N, C, S, S) on white by their rolls (N,) and cut out the squares around their turned masks."""
    return RolledCrop.around(mask, roll).cut(image, size)


def _pixels(mask: Tensor) -> tuple[Tensor, Tensor]:
    """Return coordinates (S,) across and (S, 1) down of pixels from the picture's centre."""
    side = mask.shape[-1]
    place = torch.arange(side, device=mask.device, dtype=mask.dtype) - (side - 1) / 2
    return place, place[:, None]


def _extreme(value: Tensor, there: Tensor, largest: bool) -> Tensor:
    """Return the largest or least of (N, S, S) on the object; 0 without an object."""
    filled = value.masked_fill(~there, -torch.inf if largest else torch.inf)
    extreme = filled.amax((1, 2)) if largest else filled.amin((1, 2))
    return extreme.nan_to_num(0.0, 0.0, 0.0)
