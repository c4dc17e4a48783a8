"""A head from a code to the sides of the object's bounding box."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.arguments import check_arguments


class ExtentsHead(nn.Module):
    """Predict an object's normalised extents: the three sides (x, y, z) of its box, with a diagonal of 1.

    Args:
        code_dim: D.
        hidden_dim: units of the hidden layer.

    Example:
        >>> import torch
        >>> from kfit.generators import ExtentsHead
        >>> ExtentsHead(code_dim=8)(torch.zeros(2, 8)).detach().norm(dim=1)
        tensor([1., 1.])
    """

    def __init__(self, code_dim: int = 16, hidden_dim: int = 64) -> None:
        super().__init__()
        check_arguments(ExtentsHead, locals())
        self.layers = nn.Sequential(nn.Linear(code_dim, hidden_dim), nn.LeakyReLU(0.2), nn.Linear(hidden_dim, 3))

    def forward(self, code: Tensor) -> Tensor:
        """Return extents (N, 3) of codes (N, D), positive, each row of length 1."""
        sides = self.layers(code)
        return F.normalize(F.softplus(sides.to(torch.promote_types(sides.dtype, torch.float32))) + 1e-3, dim=1)
