"""A generator of one's own: a soft ellipse of one brightness on a ground of another."""

import torch
from torch import Tensor

from kfit.core import Angle, Bounded, Generator, Positive, Rendering, Variable


class Ellipse(Generator):
    """Draws an ellipse from its ``middle`` and ``radii`` in half-widths, ``roll``, and two ``greys`` (ellipse, ground).

    Args:
        image_size: side of the picture.
        softness: width of the edge, in half-widths.
    """

    grid: Tensor

    def __init__(self, image_size: int = 64, softness: float = 0.05) -> None:
        super().__init__()
        self.variables = {
            "middle": Variable((2,)),
            "radii": Variable((2,), Positive()),
            "roll": Variable((), Angle()),
            "greys": Variable((2,), Bounded(0.0, 1.0)),
        }
        axis = torch.linspace(-1, 1, image_size)
        self.softness = softness
        self.register_buffer("grid", torch.stack(torch.meshgrid(axis, -axis, indexing="xy"), -1))

    def forward(self, middle: Tensor, radii: Tensor, roll: Tensor, greys: Tensor) -> Rendering:
        away = self.grid - middle[:, None, None]
        cos, sin = (part[:, None, None] for part in (roll.cos(), roll.sin()))
        along, across = cos * away[..., 0] + sin * away[..., 1], cos * away[..., 1] - sin * away[..., 0]
        radii = radii[:, :, None, None]
        radius = torch.sqrt((along / radii[:, 0]) ** 2 + (across / radii[:, 1]) ** 2 + 1e-6)
        mask = torch.sigmoid((1 - radius) * radii.amin(1) / self.softness)[:, None]
        ink, ground = greys[:, :, None, None, None].unbind(1)
        return Rendering(image=(ground + mask * (ink - ground)).expand(-1, 3, -1, -1), mask=mask)
