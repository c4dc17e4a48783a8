"""The square of a photo that a generator explains, and the map between its pixels and the photo's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from kornia.geometry.transform import warp_affine
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from kfit.core import Observation
from kfit.core.arguments import check_arguments
from kfit.core.check import check_float, check_positive, check_shape

# The object spans 77 % of the square, which leaves its edges and some background. The released code adds 30 pixels to
# the box, which for its boxes of some 100 pixels is the same. Shift and scale compensate the difference.
MARGIN = 1.3
LEAST_KNOWN = 0.25  # fraction of a pixel with known depth, below which its depth is unknown


@dataclass(frozen=True)
class Crop:
    """A square of a photo, resampled to a picture of ``size`` × ``size`` pixels.

    Pixel centres are at integers in both, so the square spans [centre − side / 2, centre + side / 2] and the picture
    [−1/2, size − 1/2].

    Attributes:
        centre: (x, y) in pixels of the photo; fractions are allowed.
        side: in pixels of the photo.
        size: size of the picture in its own pixels.

    Raises:
        TypeError, ValueError: if a number is not finite, or ``side`` or ``size`` is not above 0.

    Example:
        >>> import torch
        >>> from kfit.geometry import Crop
        >>> mask = torch.zeros(480, 640)
        >>> mask[200:280, 300:400] = 1
        >>> crop = Crop.around(mask)
        >>> crop
        Crop(centre=(349.5, 239.5), side=130.0, size=64)
        >>> crop.cut(torch.rand(480, 640, 3), mask).image.shape
        torch.Size([1, 3, 64, 64])
    """

    centre: tuple[float, float]
    side: float
    size: int = 64

    def __post_init__(self) -> None:
        check_arguments(Crop, vars(self), side=(check_positive,))

    @staticmethod
    def around(mask: Any, size: int = 64) -> Crop:
        """Return the square around the mask's bounding box, with side 1.3 · max(width, height).

        Args:
            mask: (H, W) array or tensor, above 1/2 on the object.
            size: size of the picture.

        Raises:
            ValueError: if the mask is empty or has another shape.
        """
        left, top, right, bottom = _bounds(torch.as_tensor(mask))
        return Crop(((left + right - 1) / 2, (top + bottom - 1) / 2), MARGIN * max(right - left, bottom - top), size)

    @property
    def crop_to_image(self) -> Tensor:
        """Matrix (3, 3), float64, from the picture's pixels (x, y, 1) to the photo's."""
        step, middle = self.side / self.size, (self.size - 1) / 2
        x, y = self.centre
        rows = [[step, 0, x - step * middle], [0, step, y - step * middle], [0, 0, 1]]
        return torch.tensor(rows, dtype=torch.float64)

    @property
    def image_to_crop(self) -> Tensor:
        """Matrix (3, 3), float64, from the photo's pixels (x, y, 1) to the picture's."""
        inverse: Tensor = torch.linalg.inv(self.crop_to_image)
        return inverse

    def cut(self, image: Any, mask: Any, depth: Any = None) -> Observation:
        """Cut out the object on white background, as an observation.

        Each pixel of the picture is the mean of the part of the photo that it spans, so large crops are not aliased.
        Colour c is averaged premultiplied by the mask m, so no background bleeds in: ⟨m c⟩ + 1 − ⟨m⟩. Outside of the
        photo the background is white and the mask 0. Depth is the mean over known pixels of the object, NaN where they
        cover less than 0.25 of the pixel.

        Args:
            image: (H, W, 3) array or tensor in [0, 1].
            mask: (H, W), 1 on the object; fractions blend.
            depth: (H, W) in metres; values that are not finite or not above 0 are unknown.

        Returns:
            One problem with image (1, 3, size, size), mask (1, 1, size, size) and, if passed, depth; float32.

        Raises:
            TypeError, ValueError: if the image is not floating point, shapes do not match, or the mask is empty.
        """
        image, mask = torch.as_tensor(image), torch.as_tensor(mask)
        check_float("image", image)
        check_shape("image", image, ("H", "W", 3))
        check_shape("mask", mask, (image.shape[0], image.shape[1]))
        # Premultiplied values are 0 outside of the mask's box, like values that a warp reads outside of its input:
        # warping the box alone gives the same picture, at a cost that does not grow with the photo.
        left, top, right, bottom = _bounds(mask > 0)
        alpha = mask[None, None, top:bottom, left:right].float()
        colour = image[None, top:bottom, left:right].float().movedim(-1, 1)
        parts = [colour * alpha, alpha]
        if depth is not None:
            depth = torch.as_tensor(depth)
            check_shape("depth", depth, tuple(mask.shape))
            away = depth[None, None, top:bottom, left:right].float()
            known = away.isfinite() & (away > 0)
            parts += [away.where(known, 0) * alpha, known * alpha]
        pixels = torch.cat(parts, 1)
        # If a pixel of the picture spans many of the photo's, blocks of 1/8 of its size are averaged first.
        block = max(1, int(self.side / self.size / 8))
        pixels = avg_pool2d(pad(pixels, (0, -(right - left) % block, 0, -(bottom - top) % block)), block)
        finer = max(1, math.ceil(self.side / self.size / block))
        x, y = ((c - start - (block - 1) / 2) / block for c, start in zip(self.centre, (left, top), strict=True))
        fine = Crop((x, y), self.side / block, self.size * finer)
        to_fine = fine.image_to_crop[None, :2].float().to(image.device)
        samples = warp_affine(pixels, to_fine, (fine.size, fine.size), align_corners=True)
        picture = avg_pool2d(samples, finer)
        alpha = picture[:, 3:4].clamp(0, 1)
        composite = (picture[:, :3] + 1 - alpha).clamp(0, 1)
        if depth is None:
            return Observation(composite, alpha)
        away, known = picture[:, 4:5], picture[:, 5:6]
        return Observation(composite, alpha, torch.where(known > LEAST_KNOWN, away / known, math.nan))


def _bounds(mask: Tensor) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the object's box, the latter two exclusive."""
    check_shape("mask", mask, ("H", "W"))
    there = mask > 0.5
    columns, rows = there.any(0).nonzero(), there.any(1).nonzero()
    if not len(columns):
        raise ValueError(f"mask is empty: none of its {mask.shape[1]} x {mask.shape[0]} pixels is above 1/2")
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
