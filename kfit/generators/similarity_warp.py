"""A generator's picture, rotated, shifted and scaled in its plane."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from kornia.geometry.transform import warp_affine
from torch import Tensor

from kfit.core import Angle, Generator, Observation, Positive, Rendering, Variable, Variables
from kfit.core.check import check_names

OWN = ("roll", "shift", "scale")
# The inner generator's focal length changes with the scale.
PLANE = (*OWN, "focal")


class SimilarityWarp(Generator):
    """Add roll, shift and scale to a generator, by a similarity warp of its picture.

    It is the warp W(T, R_z) of Chen et al. 2020, section 3.1. A point (u, v) of the generator's picture, in half-widths
    from the centre, x right and y up, moves to scale · Rz(roll) · (u, v) + shift; outside is white, mask 0. Depth is
    warped premultiplied by the mask. If the generator draws a weight, the outside of its picture has weight 1, and
    colours are warped premultiplied by the weight.

    Adds the variables ``roll`` (radians, anticlockwise), ``shift`` (2,) in half-widths of the picture (x right, y up)
    and ``scale`` (above 0; 1 keeps the size). If the generator has a ``focal``, the focal length over the picture's
    width, it is that of the finished picture. The generator draws with focal / scale, because its picture is enlarged
    by the scale; so the camera has the same distance as that of a photo in which the object is as large.

    Args:
        generator: draws the picture before the warp.

    Raises:
        ValueError: if the generator has variables of these names already.

    Example:
        >>> import torch
        >>> from kfit.generators import VAE2D, SimilarityWarp
        >>> generator = SimilarityWarp(VAE2D(code_dim=8)).eval()
        >>> values = {name: torch.zeros(2, *variable.shape) for name, variable in generator.variables.items()}
        >>> list(values), generator(**values | {"scale": torch.ones(2)}).image.shape
        (['code', 'azimuth', 'elevation', 'roll', 'shift', 'scale'], torch.Size([2, 3, 64, 64]))
    """

    def __init__(self, generator: Generator) -> None:
        super().__init__()
        taken = [name for name in OWN if name in generator.variables]
        if taken:
            raise ValueError(f"SimilarityWarp: the generator has {', '.join(taken)} already")
        self.generator = generator
        self.variables = {
            **generator.variables,
            "roll": Variable((), Angle()),
            "shift": Variable((2,)),
            "scale": Variable((), Positive()),
        }

    def prepare(self, observation: Observation) -> Mapping[str, Tensor]:
        return self.generator.prepare(observation)

    def forward(self, **values: Tensor) -> Rendering:
        inner = {name: value for name, value in values.items() if name not in OWN}
        if "focal" in inner:
            inner["focal"] = inner["focal"] / values["scale"]
        if inner and not torch.is_grad_enabled() and not torch.compiler.is_compiling():
            return warp(self._drawn_once(inner), values["roll"], values["shift"], values["scale"])
        drawn: Rendering = self.generator(**inner)
        return warp(drawn, values["roll"], values["shift"], values["scale"])

    def _drawn_once(self, inner: Variables) -> Rendering:
        """Draw all rows, but rows with equal values, as finite differences have them, only once."""
        rows = torch.cat([value.flatten(1) if value.dim() > 1 else value[:, None] for value in inner.values()], 1)
        distinct, number = rows.unique(dim=0, return_inverse=True)
        if len(distinct) == len(rows):
            alone: Rendering = self.generator(**inner)
            return alone
        every = torch.arange(len(rows), device=rows.device)
        kept = number.new_zeros(len(distinct)).scatter_reduce(0, number, every, "amin", include_self=False)
        drawn: Rendering = self.generator(**{name: value[kept] for name, value in inner.items()})
        gathered: Rendering = drawn.map(lambda tensor: tensor[number])
        return gathered

    def bind(self, **fixed: Tensor) -> Generator:
        """Fix variables; those of the inner generator are bound there.

        Raises:
            ValueError: if a name is not a variable of this generator.
        """
        check_names("bind", fixed, self.variables)
        inner = {name: value for name, value in fixed.items() if name not in PLANE}
        own = {name: value for name, value in fixed.items() if name in PLANE}
        bound = SimilarityWarp(self.generator.bind(**inner)) if inner else self
        return Generator.bind(bound, **own) if own else bound


def fixed_camera(generator: Generator) -> Generator:
    """Return the generator with its ``focal``, if it has one, fixed at its default.

    All rows are then drawn from one distance, as the paper's generator does, and no camera needs to be known.

    Example:
        >>> from kfit.generators import RadianceField, fixed_camera
        >>> list(fixed_camera(RadianceField(code_dim=8, volume_dims=(4, 4))).variables)
        ['code', 'azimuth', 'elevation']
    """
    own = getattr(generator, "focal", None)
    return generator if own is None else generator.bind(focal=own)


def warp(drawn: Rendering, roll: Tensor, shift: Tensor, scale: Tensor) -> Rendering:
    """Apply the similarity warp of `SimilarityWarp` to N drawn pictures.

    Args:
        drawn: N pictures, or one for all rows.
        roll: (N,) radians.
        shift: (N, 2) half-widths.
        scale: (N,).
    """
    height, width = drawn.image.shape[-2:]
    cos, sin = scale * roll.cos(), scale * roll.sin()
    # In pixels y points down: the direction of rotation and the sign of the y shift change.
    linear = torch.stack([cos, sin, -sin, cos], -1).view(-1, 2, 2)
    centre = shift.new_tensor([(width - 1) / 2, (height - 1) / 2])
    moved = centre + shift * shift.new_tensor([width / 2, -height / 2])
    # White outside: the difference to white is warped, whose outside is 0.
    parts = {"image": drawn.image - 1}
    if drawn.weight is not None:  # the outside has weight 1: its complement is warped
        parts = {"image": drawn.weight * torch.where(drawn.weight > 0, parts["image"], 0), "hidden": 1 - drawn.weight}
    if drawn.mask is not None:
        parts["mask"] = drawn.mask
        if drawn.depth is not None:
            parts["depth"] = drawn.depth * drawn.mask
    whole = torch.cat(list(parts.values()), 1).expand(linear.shape[0], -1, -1, -1)
    # Out of autocast: bfloat16 matrices miss by up to a fifth of a pixel.
    with torch.autocast(whole.device.type, enabled=False):
        matrix = torch.cat([linear, (moved - linear @ centre)[..., None]], -1)
        warped = warp_affine(whole, matrix, (height, width), align_corners=True)
    found = dict(zip(parts, warped.split([part.shape[1] for part in parts.values()], 1), strict=True))
    image, mask, weight = found["image"], found.get("mask"), None
    if "hidden" in found:
        weight = (1 - found["hidden"]).clamp(0, 1)
        image = image / weight.clamp_min(1e-4)
    depth = found["depth"] / found["mask"].clamp_min(1e-4) if "depth" in found else None
    return Rendering(image=image + 1, mask=mask, depth=depth, weight=weight)
