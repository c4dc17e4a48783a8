"""A category's generator by volume rendering: a learned volume of colour and density."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Angle, Generator, Positive, Rendering, Variable, Variables
from kfit.core.arguments import check_arguments
from kfit.core.bound import bind_code
from kfit.core.check import check_list, check_range, check_shape
from kfit.generators.adain import AdaIN
from kfit.generators.ray_march import EMPTY, RayMarch
from kfit.generators.refinement import Refinement
from kfit.generators.surface import Surface, surface_of
from kfit.geometry.camera import distance_by_focal, focal_by_distance
from kfit.geometry.pose import rotation_from_angles

VOLUME_SIDE = 4  # of the learned constant; each 3D layer doubles it
# Of the styles, larger than AdaIN's default: with that, codes carry less information and drawings are worse.
GAIN = 0.3
# Least slope of rays against the box's sides.
MIN_SLOPE = 1e-6


class RadianceField(Generator):
    """Draw RGB, mask and depth of one category from a code and a pose, through a pinhole camera at any distance.

    Constant volume → AdaIN → 3D up-convolutions with AdaIN → a grid of colour c and density τ in a box around the
    object. Each ray of the camera is clipped at the box's sides (Kay and Kajiya 1986) and sampled at K evenly spaced
    depths in between, near to far:
    T_k = exp(−Σ_{j<k} τ_j δ), w_k = T_k (1 − exp(−τ_k δ)), mask = Σ_k w_k, image = Σ_k w_k c_k + 1 − mask,
    depth = Σ_k w_k d_k / mask (Max 1995; Mildenhall et al. 2020, equation 3). Colour and density are interpolated
    before their sigmoid and softplus, which keeps edges sharp on a coarse grid (Sun et al. 2022). Up to here the
    picture follows from the pose by geometry alone; ``Refinement`` then corrects colour and mask a little. In
    evaluation mode samples with a weight below 1e-4 in their pixel, most of them, are skipped.

    Variables: ``code`` (code_dim,), ``azimuth`` and ``elevation`` (radians), and ``focal`` (above 0), the focal length
    over the picture's width. It determines the camera's distance (`kfit.geometry.distance_by_focal`), at which the
    object has the same size in the picture. 1.7 M parameters, 0.22 G multiply-adds a picture in its convolutions,
    0.17 G unrefined. Depth is in box diagonals behind the object's centre.

    Args:
        code_dim: size of the code.
        volume_dims: channels of the constant volume and after each 3D up-convolution but the last, which gives colour
            and density; the grid has 4 · 2^len(volume_dims) cells along each side.
        num_samples: K, depths along a ray.
        image_size: S, side of the pictures.
        distance: distance of the camera from the object's centre, in box diagonals, if ``focal`` is not passed.
        unit_fraction: fraction of the picture's width that the silhouette of the object's bounding sphere, whose
            diameter is the box diagonal, spans at every distance. ``lightning`` sets it from the data's category.
        sides: sides of the box along x, y and z, in diagonals of the object; parts outside are not drawn. A smaller box
            has finer cells. ``lightning`` sets it from the category of procedural data.
        refined: whether to correct pictures in 2D. Without it pixels are independent, so that training can draw a part
            of them (``pixel_stride``).

    Raises:
        ValueError: if the camera is nearer than a diagonal, the fraction is outside [0.1, 10], or ``sides`` are not
            three numbers in (0, 1].

    Example:
        >>> import torch
        >>> from kfit.generators import RadianceField
        >>> field = RadianceField(code_dim=8, volume_dims=(8, 4), num_samples=8, image_size=16).eval()
        >>> pose = {"azimuth": torch.zeros(1), "elevation": torch.zeros(1), "focal": torch.tensor([1.2])}
        >>> field(code=torch.zeros(1, 8), **pose).image.shape
        torch.Size([1, 3, 16, 16])
        >>> field.bind(code=torch.zeros(8))(**pose).image.shape  # computes the volume once
        torch.Size([1, 3, 16, 16])
    """

    rays: Tensor
    half_sides: Tensor
    focal: Tensor

    def __init__(
        self,
        code_dim: int = 16,
        volume_dims: Sequence[int] = (256, 64, 32),
        num_samples: int = 24,
        image_size: int = 64,
        distance: float = 4.0,
        unit_fraction: float = 1.0,
        sides: Sequence[float] = (1.0, 1.0, 1.0),
        refined: bool = True,
    ) -> None:
        super().__init__()
        check_arguments(
            RadianceField,
            locals(),
            distance=(1, 1e6),
            unit_fraction=(0.1, 10),
            sides=(check_list, 3, check_range, 1e-3, 1),
        )
        self.variables = {
            "code": Variable((code_dim,)),
            "azimuth": Variable((), Angle()),
            "elevation": Variable((), Angle()),
            "focal": Variable((), Positive()),
        }
        self.code_dim, self.image_size, self.num_samples = code_dim, image_size, num_samples
        self.constant = nn.Parameter(torch.randn(1, volume_dims[0], *[VOLUME_SIDE] * 3))
        self.lift = nn.ModuleList(nn.ConvTranspose3d(a, b, 4, 2, 1) for a, b in pairwise((*volume_dims, 4)))
        # The initial density is low: rays must reach all cells, because hidden cells learn nothing.
        nn.init.constant_(self.lift[-1].bias[3:], EMPTY / 3)  # type: ignore[index, arg-type]
        self.styles = nn.ModuleList(AdaIN(dim, code_dim, gain=GAIN) for dim in volume_dims)
        self.refinement = Refinement(code_dim) if refined else None
        # Direction of each pixel's ray for a focal length of the picture's width: right, up and ahead.
        place = (torch.arange(image_size) - (image_size - 1) / 2) / image_size
        down, right = torch.meshgrid(place, place, indexing="ij")
        self.register_buffer("rays", torch.stack([right, -down, -torch.ones_like(right)], -1), persistent=False)
        self.register_buffer("focal", focal_by_distance(torch.tensor(distance), unit_fraction), persistent=False)
        self.unit_fraction = unit_fraction
        self.register_buffer("half_sides", torch.tensor(sides) / 2, persistent=False)
        # Optical depth of a diagonal per unit of the softplus: 0.25 a pixel.
        self.thickness = unit_fraction * image_size / 4

    def forward(self, *, pixels: Tensor | None = None, **values: Tensor) -> Rendering:
        """Draw pictures or, with ``pixels`` (2, n), only the n × n pixels of these rows and columns.

        Raises:
            ValueError: if ``pixels`` are passed to a generator with refinement.
        """
        if pixels is not None and self.refinement is not None:
            raise ValueError("RadianceField draws whole pictures where refined is true, so pixel_stride must be 1")
        rays = self.rays if pixels is None else self.rays[pixels[0]][:, pixels[1]]
        drawn = self._picture(self._volume(values["code"]), values, rays)
        return drawn if self.refinement is None else self.refinement(drawn, self.refinement.style(values["code"]))

    def bind(self, **fixed: Tensor) -> Generator:
        """Fix variables; the volume of a fixed code is computed here, once.

        Raises:
            ValueError: if a name is not a variable of this generator, or a value has another shape.
        """
        return bind_code(self, fixed, lambda code: _BoundCode(self, code))

    def surface(self, code: Tensor) -> Surface:
        """Return the surface of a code (code_dim,): a mesh in the object's frame, in box diagonals.

        Raises:
            ValueError: if nothing in the volume is dense enough.
        """
        check_shape("RadianceField: code", code, (self.code_dim,))
        with torch.no_grad():
            return surface_of(self._volume(code[None])[0], self.half_sides, self.thickness)

    def _volume(self, code: Tensor) -> Tensor:
        """Return raw colour and density (N, 4, D, H, W), the density relative to empty space."""
        volume = self.constant.expand(code.shape[0], *self.constant.shape[1:])
        for style, lift in zip(self.styles, self.lift, strict=True):
            volume = lift(F.leaky_relu(style(volume, style.style(code)), 0.2))  # type: ignore[operator]
        volume = volume.to(torch.promote_types(volume.dtype, torch.float32))
        return volume - volume.new_tensor([0.0, 0.0, 0.0, EMPTY]).view(1, 4, 1, 1, 1)

    def _picture(self, volume: Tensor, values: Variables, rays: Tensor) -> Rendering:
        # Without autocast: points in bfloat16 are off by cells, and the gradient of the angles loses its direction.
        with torch.autocast(volume.device.type, enabled=False):
            azimuth, elevation = values["azimuth"], values["elevation"]
            focal = values.get("focal", self.focal.expand_as(azimuth))[:, None, None]
            rotation = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth))
            # A point p of the camera's frame is Rᵀp in the object's; the box is the cube [−1, 1]³ of `grid_sample`,
            # with (x, y, z) = (W, H, D).
            axes = rotation / self.half_sides
            across, ahead = axes[:, :2] / focal, axes[:, 2:]
            # The change of a ray's point as depth grows by a diagonal, and its point at the depth of the object's
            # centre.
            along = rays.flatten(0, 1) @ torch.cat([across, ahead], 1).to(volume.dtype)
            at_centre = across * distance_by_focal(focal, self.unit_fraction)
            past = rays[..., :2].flatten(0, 1) @ at_centre.to(volume.dtype)
            past, along = (part.unflatten(1, rays.shape[:2]) for part in (past, along))
            along = torch.where(along.abs() < MIN_SLOPE, MIN_SLOPE, along)
            walls = torch.stack([(-1 - past) / along, (1 - past) / along])
            # Objects of unit diagonal lie within half a diagonal of their centre at every rotation.
            near = walls.amin(0).amax(-1).clamp(-0.5, 0.5)
            step = (walls.amax(0).amin(-1).clamp(-0.5, 0.5) - near).clamp_min(0) / self.num_samples
            march = RayMarch(past, along, near, step, self.num_samples, self.thickness)
            # Training, compilation and export need all samples.
            whole = self.training or torch.compiler.is_compiling()
            return march.whole(volume) if whole else march.where_it_counts(volume)


class _BoundCode(Generator):
    volume: Tensor
    style: Tensor | None

    def __init__(self, generator: RadianceField, code: Tensor) -> None:
        super().__init__()
        self.generator = generator
        self.variables = {name: v for name, v in generator.variables.items() if name != "code"}
        with torch.no_grad():
            style = None if generator.refinement is None else generator.refinement.style(code[None])
            self.register_buffer("volume", generator._volume(code[None]), persistent=False)
            self.register_buffer("style", style, persistent=False)

    def forward(self, **values: Tensor) -> Rendering:
        rows, field = len(values["azimuth"]), self.generator
        drawn = field._picture(self.volume.expand(rows, *self.volume.shape[1:]), values, field.rays)
        if field.refinement is None or self.style is None:
            return drawn
        refined: Rendering = field.refinement(drawn, self.style.expand(rows, -1))
        return refined
