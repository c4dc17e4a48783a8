"""A fixed picture moved in its plane: image registration as a fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from kornia.geometry.transform import remap
from torch import Tensor

from kfit.core import Generator, Observation, Positive, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.core.check import check_float, check_shape
from kfit.generators.motions import (
    BENDING,
    Motion,
    bent,
    matrix_of,
    motion_variables,
    outer_corners,
    pixel_grid,
    read_through_matrix,
    spline_basis,
)

# Pixels with less coverage count as outside: their colour would be a quotient of two small numbers.
LEAST_COVER = 1e-3
LIGHT = {"gain": Variable((), Positive()), "bias": Variable()}


class Template(Generator):
    """Draw a fixed picture, warped; a fit to an observation of the same scene is image registration.

    A point p of the template, in pixels from the centre, x right and y up, moves to

    - translation: p + shift;
    - euclidean: R(roll) · p + shift;
    - similarity: scale · R(roll) · p + shift, as in `SimilarityWarp`;
    - affine: scale · R(roll) · [[stretch, shear], [0, 1/stretch]] · p + shift;
    - homography: its image under the projective map that moves the picture's corners by ``corners`` (4, 2), clockwise
      from the top left, which conditions a fit better than the matrix (Baker, Datta and Kanade, "Parameterizing
      homographies", 2006).

    Two motions are non-rigid. A pixel p of the drawing, x right and y down, shows the template at p + u(p), like
    displacement fields of SimpleITK and flows of scikit-image. u interpolates ``displacement`` (2, rows, columns) of
    control points that span the picture: by a thin-plate spline (tps), or bicubically (flow; with as many control
    points as pixels it is dense).

    Lengths are in half-widths and half-heights, ``roll`` in radians anticlockwise. The identity is 0 for all variables
    and 1 for scale, stretch and gain. Mask and weight of the rendering are the template's coverage of each pixel, so a
    fit compares the overlap alone, and `kfit.FitPipeline`'s ``min_overlap`` keeps the template in the frame. A partly
    covered pixel has the colour of the covered part.

    Args:
        picture: (C, H, W) in [0, 1], or (B, C, H, W), a template for each of B problems.
        motion: "translation", "euclidean", "similarity", "affine", "homography", "tps" or "flow".
        fill: brightness outside of the template, which has weight 0.
        mask: (1, H, W), or (B, 1, H, W), in [0, 1], where the template is known; everywhere by default.
        light: whether to fit ``gain`` (above 0) and ``bias`` of the template's brightness, gain · picture + bias.
        oversampling: factor by which a cubic spline refines the grid, along each side, before the warp samples it. At
            1 the warp is bilinear between pixels, whose blur depends on the position between them and biases a fit by
            about 0.01 pixel; 4 halves that.
        control: (rows, columns) of control points of tps and flow.

    Raises:
        TypeError, ValueError: if the picture holds integers or has another shape, the motion is unknown, the
            oversampling is below 1, a side has fewer than 2 control points or, in a fit, the number of problems
            differs from that of templates.

    Example:
        >>> import torch
        >>> from kfit.generators import Template
        >>> template = Template(torch.rand(3, 64, 64), "similarity")
        >>> drawn = template(roll=torch.zeros(1), scale=torch.ones(1), shift=torch.tensor([[1.0, 0.0]]))
        >>> drawn.weight.mean()  # moved by half of the width, half of the frame is covered
        tensor(0.5000)
    """

    pixels: Tensor
    basis: Tensor | None

    def __init__(
        self,
        picture: Tensor,
        motion: Motion = "homography",
        fill: float = 1.0,
        mask: Tensor | None = None,
        light: bool = False,
        oversampling: int = 1,
        control: tuple[int, int] = (5, 5),
    ) -> None:
        super().__init__()
        single = isinstance(picture, Tensor) and picture.dim() == 3
        check_shape("picture", picture, ("C", "H", "W") if single else ("B", "C", "H", "W"))
        check_float("picture", picture)
        check_arguments(Template, locals(), oversampling=(1, 16), control=(2,))
        mask = torch.ones_like(picture[..., :1, :, :]) if mask is None else mask
        check_shape("mask", mask, tuple(picture[..., :1, :, :].shape))
        picture, mask = (picture[None], mask[None]) if single else (picture, mask)
        self.motion, self.fill, self.oversampling, self.control = motion, fill, oversampling, tuple(control)
        self.size = (picture.shape[-2], picture.shape[-1])
        self.moving = motion_variables(motion, (control[0], control[1]))
        self.variables = {**self.moving, **(LIGHT if light else {})}
        picture, mask = _finer(picture.detach(), mask.detach(), oversampling)
        self.register_buffer("pixels", torch.cat([picture * mask, mask], 1))
        basis = spline_basis((control[0], control[1]), self.size).to(picture) if motion == "tps" else None
        self.register_buffer("basis", basis, persistent=False)

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        count = observation.num_problems
        if len(self.pixels) == 1:
            return {}
        if len(self.pixels) != count:
            raise ValueError(f"Template: {len(self.pixels)} pictures cannot be fitted to {count} problems")
        return {"template": torch.arange(count, device=self.pixels.device)}

    def forward(self, **values: Tensor) -> Rendering:
        read = self.places(**{name: value for name, value in values.items() if name in self.moving})
        template = values.get("template")
        pixels = self.pixels.expand(len(read), -1, -1, -1) if template is None else self.pixels[template]
        # Without autocast: positions in bfloat16 are off by pixels.
        with torch.autocast(pixels.device.type, enabled=False):
            warped = remap(pixels, *(read.to(pixels) * self.oversampling).unbind(-1), align_corners=True)
        cover = warped[:, -1:]
        covered = cover > LEAST_COVER
        image = warped[:, :-1] / torch.where(covered, cover, 1)
        if "gain" in values:
            image = values["gain"].view(-1, 1, 1, 1) * image + values["bias"].view(-1, 1, 1, 1)
        mask = torch.where(covered, cover, 0)
        return Rendering(image=torch.where(covered, image, self.fill), mask=mask, weight=mask)

    def places(self, **values: Tensor) -> Tensor:
        """Return the positions (N, H, W, 2), as (x, y) in template pixels, that the drawing samples.

        Args:
            values: values of the motion's variables, (N, \\*shape) each.
        """
        with torch.autocast(self.pixels.device.type, enabled=False):
            if self.motion not in BENDING:
                return read_through_matrix(self.matrix(**values), self.size)
            field = bent(values["displacement"], self.size, self.basis)
            return pixel_grid(field, self.size) + field

    def matrix(self, **values: Tensor) -> Tensor:
        """Return matrices (N, 3, 3) from the template's pixels to the drawing's, pixel centres at integers.

        Args:
            values: values of the motion's variables, (N, \\*shape) each.

        Raises:
            ValueError: if the motion is non-rigid, which is not a matrix.
        """
        if self.motion in BENDING:
            raise ValueError(f"matrix: {self.motion} bends the picture, which no matrix does; see places")
        return matrix_of(self.motion, values, self.size)

    def corners(self, matrix: Tensor) -> Tensor:
        """Return the displacement (N, 4, 2) of the corners by matrices (N, 3, 3), in half-sides, y up.

        It converts the result of another motion to the start of a homography.
        """
        height, width = self.size
        start = outer_corners(matrix, self.size).expand(len(matrix), 4, 2)
        apart: Tensor = transform_points(matrix, start) - start
        return apart / matrix.new_tensor([width / 2, -height / 2])


def _finer(picture: Tensor, mask: Tensor, times: int) -> tuple[Tensor, Tensor]:
    """Refine a picture and its mask to a grid ``times`` finer that starts and ends at the same pixel centres."""
    if times == 1:
        return picture, mask
    from scipy.ndimage import zoom  # type: ignore[import-untyped]

    size = [(side - 1) * times + 1 for side in picture.shape[-2:]]
    factors = [new / old for new, old in zip(size, picture.shape[-2:], strict=True)]
    # One plane at a time: a spline of four axes would take 16 × as long.
    planes = [zoom(plane, factors, order=3, mode="mirror") for plane in picture.flatten(0, 1).double().cpu().numpy()]
    finer = torch.from_numpy(np.stack(planes)).unflatten(0, picture.shape[:2])
    # The mask is bilinear, because a spline rings at edges.
    mask = F.interpolate(mask, size, mode="bilinear", align_corners=True)
    return finer.to(picture), mask
