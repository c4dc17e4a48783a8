"""The paper's generator: a learned volume that is rotated in space and drawn by a 2D decoder."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from kornia.geometry.transform import warp_affine3d
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Angle, Generator, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.core.bound import bind_code
from kfit.generators.adain import AdaIN
from kfit.geometry.pose import rotation_from_angles

VOLUME_SIDE = 4  # of the learned constant; each 3D layer doubles it


class VAE3D(Generator):
    """Draw RGB and mask of one category from a code, an azimuth and an elevation (Chen et al. 2020, section 3.1).

    Constant volume → AdaIN → 3D up-convolutions with AdaIN → rotation R = Rx(elevation) · Ry(azimuth) → projection
    (depth folded into channels, 1×1 convolution) → 2D up-convolutions with AdaIN → sigmoid. The defaults are the
    compact network: 2.0 M parameters, 0.45 G multiply-adds a picture. The released code's sizes are `VAE3D.paper`.

    Variables: ``code`` (code_dim,), ``azimuth`` and ``elevation`` (radians). Draws (N, 3, S, S) with
    S = 16 · 2^len(decoder_dims), that is 64.

    Args:
        code_dim: size of the code.
        volume_dims: channels of the constant volume and after each 3D up-convolution.
        projection_dim: channels after the projection.
        decoder_dims: channels after each 2D up-convolution.
        rectified: styles through a ReLU, as in the released code.
        depth: whether to draw depth too (the paper's RGB-D model), in box diagonals behind the object's centre.
        mask: whether to draw a mask; the released networks have none.

    Example:
        >>> import torch
        >>> from kfit.generators import VAE3D
        >>> generator = VAE3D(code_dim=8, volume_dims=(8, 8), projection_dim=8, decoder_dims=(8,))
        >>> generator(code=torch.zeros(2, 8), azimuth=torch.zeros(2), elevation=torch.zeros(2)).image.shape
        torch.Size([2, 3, 16, 16])
    """

    def __init__(
        self,
        code_dim: int = 16,
        volume_dims: Sequence[int] = (256, 64, 32),
        projection_dim: int = 256,
        decoder_dims: Sequence[int] = (128, 64),
        rectified: bool = False,
        depth: bool = False,
        mask: bool = True,
    ) -> None:
        super().__init__()
        check_arguments(VAE3D, locals())
        self.variables = {
            "code": Variable((code_dim,)),
            "azimuth": Variable((), Angle()),
            "elevation": Variable((), Angle()),
        }
        self.code_dim = code_dim
        side = VOLUME_SIDE * 2 ** (len(volume_dims) - 1)
        self.image_size = side * 2 ** len(decoder_dims)
        self.constant = nn.Parameter(torch.randn(1, volume_dims[0], *[VOLUME_SIDE] * 3))
        self.lift = nn.ModuleList(nn.ConvTranspose3d(a, b, 4, 2, 1) for a, b in pairwise(volume_dims))
        self.project = nn.Conv2d(volume_dims[-1] * side, projection_dim, 1)
        widths = (projection_dim, *decoder_dims)
        self.decode = nn.ModuleList(nn.ConvTranspose2d(a, b, 4, 2, 1) for a, b in pairwise(widths))
        self.draws_mask, self.draws_depth = mask, depth
        self.draw = nn.Conv2d(widths[-1], 3 + mask + depth, 3, 1, 1)
        self.styles = nn.ModuleList(AdaIN(dim, code_dim, rectified) for dim in (*volume_dims, *decoder_dims))

    @classmethod
    def paper(cls, code_dim: int = 16, depth: bool = False, mask: bool = True) -> VAE3D:
        """Build the released code's sizes (neural_object_fitting@7309348): 10.3 M parameters, 2.2 G multiply-adds."""
        return cls(code_dim, (512, 128, 64), 1024, (256, 64), rectified=True, depth=depth, mask=mask)

    def forward(self, **values: Tensor) -> Rendering:
        volume, styles = self._volume(values["code"])
        return self._picture(volume, styles, values["azimuth"], values["elevation"])

    def bind(self, **fixed: Tensor) -> Generator:
        """Fix variables; the volume and styles of a fixed code are computed here, once.

        Raises:
            ValueError: if a name is not a variable of this generator, or a value has another shape.
        """
        return bind_code(self, fixed, lambda code: _BoundCode(self, code))

    def _volume(self, code: Tensor) -> tuple[Tensor, list[Tensor]]:
        styles = [layer.style(code) for layer in self.styles]  # type: ignore[operator]
        volume = self.constant.expand(code.shape[0], *self.constant.shape[1:])
        volume = F.leaky_relu(self.styles[0](volume, styles[0]), 0.2)
        for index, lift in enumerate(self.lift, 1):
            volume = F.leaky_relu(self.styles[index](lift(volume), styles[index]), 0.2)
        return volume, styles

    def _picture(self, volume: Tensor, styles: list[Tensor], azimuth: Tensor, elevation: Tensor) -> Rendering:
        # The rotation is computed without autocast: in bfloat16 it is off by up to 0.14 voxel, and the gradient of the
        # angles loses its direction.
        with torch.autocast(volume.device.type, enabled=False):
            single = torch.promote_types(azimuth.dtype, torch.float32)
            azimuth, elevation = azimuth.to(single), elevation.to(single)
            rotated = turn_volume(volume, rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth)))
        picture = F.leaky_relu(self.project(rotated.flatten(1, 2).to(self.project.weight.dtype)), 0.2)
        for index, decode in enumerate(self.decode, 1 + len(self.lift)):
            picture = F.leaky_relu(self.styles[index](decode(picture), styles[index]), 0.2)
        channels = self.draw(picture)
        channels = channels.to(torch.promote_types(channels.dtype, torch.float32))
        mask = torch.sigmoid(channels[:, 3:4]) if self.draws_mask else None
        return Rendering(torch.sigmoid(channels[:, :3]), mask, channels[:, -1:] if self.draws_depth else None)


class _BoundCode(Generator):
    volume: Tensor
    styles: Tensor

    def __init__(self, generator: VAE3D, code: Tensor) -> None:
        super().__init__()
        self.generator = generator
        self.variables = {name: v for name, v in generator.variables.items() if name != "code"}
        with torch.no_grad():
            volume, styles = generator._volume(code[None])
        self.widths = [style.shape[1] for style in styles]
        self.register_buffer("volume", volume, persistent=False)
        self.register_buffer("styles", torch.cat(styles, 1), persistent=False)

    def forward(self, **values: Tensor) -> Rendering:
        rows = values["azimuth"].shape[0]
        volume, styles = (held.expand(rows, *held.shape[1:]) for held in (self.volume, self.styles))
        apart = list(styles.split(self.widths, 1))
        return self.generator._picture(volume, apart, values["azimuth"], values["elevation"])


def turn_volume(volume: Tensor, rotation: Tensor) -> Tensor:
    """Rotate volumes about their centres.

    Axes of the volume (D, H, W) are depth away from the viewer, down and right, so a rotation R of the y-up frame acts
    as F·R·F on (x, y, z) voxel coordinates, F = diag(1, −1, −1). The border is repeated outside.

    Args:
        volume: (N, C, D, H, W), a cube.
        rotation: (N, 3, 3) in the y-up frame.
    """
    flip = rotation.new_tensor([1.0, -1.0, -1.0])
    inside = rotation * flip[:, None] * flip
    centre = rotation.new_tensor([(size - 1) / 2 for size in reversed(volume.shape[2:])])
    matrix = torch.cat([inside, (centre - inside @ centre)[..., None]], -1)
    rotated: Tensor = warp_affine3d(
        volume.to(matrix.dtype), matrix, tuple(volume.shape[2:]), padding_mode="border", align_corners=True
    )
    return rotated
