"""A fixed picture moved in its plane: image registration as a fit."""

from __future__ import annotations

from typing import Literal

import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from kornia.geometry.transform import get_perspective_transform, warp_perspective
from torch import Tensor

from kfit.core import Angle, Generator, Positive, Rendering, Variable, Variables
from kfit.core.check import check_choice, check_count, check_float, check_range, check_shape

Motion = Literal["similarity", "affine", "homography"]
MOTIONS: dict[str, dict[str, Variable]] = {
    "similarity": {"roll": Variable((), Angle()), "shift": Variable((2,)), "scale": Variable((), Positive())},
    "affine": {
        "roll": Variable((), Angle()),
        "shift": Variable((2,)),
        "scale": Variable((), Positive()),
        "stretch": Variable((), Positive()),
        "shear": Variable(),
    },
    "homography": {"corners": Variable((4, 2))},
}
# A pixel of which less is covered counts as outside: its colour would be a quotient of two small numbers.
LEAST_COVER = 1e-3
LIGHT = {"gain": Variable((), Positive()), "bias": Variable()}


class Template(Generator):
    """Draws a picture of its own, warped; with an observation of the same scene, its fit is image registration.

    A point p of the template, in pixels from the centre, x right and y up, goes to

    - similarity: scale · R(roll) · p + shift, as in `SimilarityWarp`;
    - affine: scale · R(roll) · [[stretch, shear], [0, 1/stretch]] · p + shift;
    - homography: where the projective map takes it that moves the picture's corners by ``corners`` (4, 2), from the
      top left clockwise, which conditions a fit better than the matrix (Baker, Datta and Kanade, "Parameterizing
      homographies", 2006).

    ``shift`` and ``corners`` are in half-widths and half-heights, ``roll`` in radians anticlockwise. Variables of 0,
    and of 1 for scale, stretch and gain, leave the picture as it is. Mask and weight of the rendering are what the
    template covers of each pixel: outside it nothing counts, so a fit compares the overlap alone and
    `kfit.FitPipeline`'s ``min_overlap`` keeps the template in the frame. A pixel that it covers in part has the colour
    of that part.

    Args:
        picture: (C, H, W) in [0, 1].
        motion: "similarity", "affine" or "homography".
        fill: the brightness drawn outside, which is shown but never counts.
        mask: (1, H, W) in [0, 1], where the template is known; everywhere unless given.
        light: also fit ``gain`` (above 0) and ``bias`` of the template's brightness, gain · picture + bias.
        oversampling: how many times finer, along each side, the grid is from which the warp reads; a cubic spline
            fills it in. At 1 the warp is bilinear between pixels, which blurs by how far a point lies between them,
            and so draws a fit about a hundredth of a pixel off the truth; 4 leaves half of that.

    Raises:
        TypeError, ValueError: for a picture of integers or of another shape, an unknown motion, and an oversampling
            below 1.
    """

    pixels: Tensor

    def __init__(
        self,
        picture: Tensor,
        motion: Motion = "homography",
        fill: float = 1.0,
        mask: Tensor | None = None,
        light: bool = False,
        oversampling: int = 1,
    ) -> None:
        super().__init__()
        check_shape("picture", picture, ("C", "H", "W"))
        check_float("picture", picture)
        check_choice("motion", motion, MOTIONS)
        check_choice("light", light, (False, True))
        check_count("oversampling", oversampling, 1, 16)
        check_range("fill", fill)
        mask = torch.ones_like(picture[:1]) if mask is None else mask
        check_shape("mask", mask, tuple(picture[:1].shape))
        self.motion, self.fill, self.oversampling, self.size = motion, fill, oversampling, picture.shape[-2:]
        self.variables = {**MOTIONS[motion], **(LIGHT if light else {})}
        picture, mask = _finer(picture.detach(), mask.detach(), oversampling)
        self.register_buffer("pixels", torch.cat([picture * mask, mask])[None])

    def forward(self, **values: Tensor) -> Rendering:
        matrix = self.matrix(**{name: value for name, value in values.items() if name not in LIGHT})
        pixels = self.pixels.expand(len(matrix), -1, -1, -1)
        # Out of autocast: bfloat16 matrices miss by pixels.
        with torch.autocast(pixels.device.type, enabled=False):
            from_finer = matrix * matrix.new_tensor([1 / self.oversampling, 1 / self.oversampling, 1.0])
            warped = warp_perspective(pixels, from_finer, self.size, align_corners=True)
        cover = warped[:, -1:]
        covered = cover > LEAST_COVER
        image = warped[:, :-1] / torch.where(covered, cover, 1)
        if "gain" in values:
            image = values["gain"].view(-1, 1, 1, 1) * image + values["bias"].view(-1, 1, 1, 1)
        mask = torch.where(covered, cover, 0)
        return Rendering(image=torch.where(covered, image, self.fill), mask=mask, weight=mask)

    def matrix(self, **values: Tensor) -> Tensor:
        """Where pixels go: (N, 3, 3), from the template's pixels to the drawing's, centres at whole numbers.

        Args:
            values: of the variables that move, (N, \\*shape) each.
        """
        height, width = self.size
        like = next(iter(values.values()))
        half, middle = like.new_tensor([width / 2, height / 2]), like.new_tensor([(width - 1) / 2, (height - 1) / 2])
        # In pixels y points down.
        flip = like.new_tensor([1.0, -1.0])
        if self.motion == "homography":
            start = self._corners(like).expand(len(like), 4, 2)
            moved: Tensor = get_perspective_transform(start, start + values["corners"] * half * flip)
            return moved
        linear, shift = _linear(values), values["shift"] * half * flip
        linear = linear * flip[:, None] * flip
        offset = middle + shift - linear @ middle
        bottom = like.new_tensor([0.0, 0.0, 1.0]).expand(len(linear), 1, 3)
        return torch.cat([torch.cat([linear, offset[..., None]], 2), bottom], 1)

    def corners(self, matrix: Tensor) -> Tensor:
        """How far a map of pixels (N, 3, 3) moves the corners, (N, 4, 2) in half-widths and half-heights, y up.

        It takes what another motion has found to where a homography starts.
        """
        height, width = self.size
        start = self._corners(matrix).expand(len(matrix), 4, 2)
        apart: Tensor = transform_points(matrix, start) - start
        return apart / matrix.new_tensor([width / 2, -height / 2])

    def _corners(self, like: Tensor) -> Tensor:
        """The outer corners of the picture in pixels, (4, 2)."""
        bottom, right = self.size[0] - 0.5, self.size[1] - 0.5
        return like.new_tensor([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


def _finer(picture: Tensor, mask: Tensor, times: int) -> tuple[Tensor, Tensor]:
    """A picture and its mask on a grid ``times`` finer that starts and ends at the same pixel centres."""
    if times == 1:
        return picture, mask
    from scipy.ndimage import zoom  # type: ignore[import-untyped]

    size = [(side - 1) * times + 1 for side in picture.shape[-2:]]
    factors = [1, size[0] / picture.shape[-2], size[1] / picture.shape[-1]]
    spline = zoom(picture.double().cpu().numpy(), factors, order=3, mode="mirror")
    # No spline for the mask, which would ring at its edges.
    mask = F.interpolate(mask[None], size, mode="bilinear", align_corners=True)[0]
    return torch.from_numpy(spline).to(picture), mask


def _linear(values: Variables) -> Tensor:
    """(N, 2, 2), y up."""
    cos, sin = values["scale"] * values["roll"].cos(), values["scale"] * values["roll"].sin()
    turn = torch.stack([cos, -sin, sin, cos], -1).view(-1, 2, 2)
    if "stretch" not in values:
        return turn
    zero, stretch = torch.zeros_like(cos), values["stretch"]
    return turn @ torch.stack([stretch, values["shear"], zero, 1 / stretch], -1).view(-1, 2, 2)
