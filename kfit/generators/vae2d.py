"""The paper's generator without 3D: the pose is concatenated to the code, and 2D convolutions draw."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Angle, Generator, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.generators.adain import AdaIN

SIDE = 4  # of the learned constant; each layer doubles it


class VAE2D(Generator):
    """Draw the pictures of `VAE3D` by 2D convolutions only (Chen et al. 2020, section 4.2, "w/o 3D").

    Constant → AdaIN → up-convolutions with AdaIN → 3×3 convolution → sigmoid. The pose is concatenated to the code as
    (sin, cos) of both angles, so that it is periodic, and both enter every AdaIN. The defaults have 2.8 M parameters
    and 0.36 G multiply-adds a picture, about as many as the compact `VAE3D`.

    Variables: ``code`` (code_dim,), ``azimuth`` and ``elevation`` (radians). Draws (N, 3, S, S) with
    S = 4 · 2^(len(decoder_dims) − 1), 64 by default.

    Args:
        code_dim: size of the code.
        decoder_dims: channels of the constant and after each up-convolution.
        depth: whether to draw depth too, in box diagonals behind the object's centre.

    Example:
        >>> import torch
        >>> from kfit.generators import VAE2D
        >>> generator = VAE2D(code_dim=8, decoder_dims=(8, 8, 8))
        >>> generator(code=torch.zeros(2, 8), azimuth=torch.zeros(2), elevation=torch.zeros(2)).image.shape
        torch.Size([2, 3, 16, 16])
    """

    def __init__(
        self, code_dim: int = 16, decoder_dims: Sequence[int] = (256, 256, 256, 128, 64), depth: bool = False
    ) -> None:
        super().__init__()
        check_arguments(VAE2D, locals())
        self.variables = {
            "code": Variable((code_dim,)),
            "azimuth": Variable((), Angle()),
            "elevation": Variable((), Angle()),
        }
        self.code_dim, self.draws_depth = code_dim, depth
        self.image_size = SIDE * 2 ** (len(decoder_dims) - 1)
        self.constant = nn.Parameter(torch.randn(1, decoder_dims[0], SIDE, SIDE))
        self.decode = nn.ModuleList(nn.ConvTranspose2d(a, b, 4, 2, 1) for a, b in pairwise(decoder_dims))
        self.draw = nn.Conv2d(decoder_dims[-1], 4 + depth, 3, 1, 1)
        self.styles = nn.ModuleList(AdaIN(dim, code_dim + 4) for dim in decoder_dims)

    def forward(self, **values: Tensor) -> Rendering:
        angles = torch.stack([values["azimuth"], values["elevation"]], 1)
        inputs = torch.cat([values["code"], angles.sin(), angles.cos()], 1)
        styles = [layer.style(inputs) for layer in self.styles]  # type: ignore[operator]
        picture = self.constant.expand(inputs.shape[0], *self.constant.shape[1:])
        picture = F.leaky_relu(self.styles[0](picture, styles[0]), 0.2)
        for index, decode in enumerate(self.decode, 1):
            picture = F.leaky_relu(self.styles[index](decode(picture), styles[index]), 0.2)
        channels = self.draw(picture)
        channels = channels.to(torch.promote_types(channels.dtype, torch.float32))
        drawn = torch.sigmoid(channels[:, :4])
        return Rendering(drawn[:, :3], drawn[:, 3:], channels[:, 4:] if self.draws_depth else None)
