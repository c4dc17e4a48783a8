"""A small network that corrects drawn pictures in 2D."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core import Rendering
from kfit.generators.adain import AdaIN
from kfit.runtime.old_weights import read_old_weights

# Colours and masks are kept this far from 0 and 1, where logits are infinite.
MARGIN = 1e-3


class Refinement(nn.Module):
    """Add a residual r, predicted from the neighbourhood of a pixel and the code, to logits of colour and mask.

    x' = σ(σ⁻¹(x) + r(image, mask, depth; code)) for x of colour and mask; depth is unchanged. r is 3×3 convolutions
    with AdaIN between them, initially nearly zero. A 2D network corrects errors of volumes that are drawn by geometry
    alone (`RadianceField`), such as the outline of a thin handle; see also Niemeyer and Geiger (2021).

    Args:
        code_dim: size of the code.
        dims: channels between the convolutions.
    """

    def __init__(self, code_dim: int, dims: Sequence[int] = (32, 32)) -> None:
        super().__init__()
        self.features = nn.ModuleList(nn.Conv2d(a, b, 3, 1, 1) for a, b in pairwise((5, *dims)))
        self.styles = nn.ModuleList(AdaIN(dim, code_dim) for dim in dims)
        self.output = nn.Conv2d(dims[-1], 4, 3, 1, 1)
        nn.init.normal_(self.output.weight, std=1e-3)
        nn.init.zeros_(self.output.bias)  # type: ignore[arg-type]
        read_old_weights(self)

    def style(self, code: Tensor) -> Tensor:
        """Return the styles (N, 2 · sum(dims)) of all layers for codes (N, D)."""
        return torch.cat([layer.style(code) for layer in self.styles], 1)  # type: ignore[operator]

    def forward(self, drawn: Rendering, style: Tensor) -> Rendering:
        """Correct pictures with mask and depth (N, ·, S, S), with the result of `style`."""
        assert drawn.mask is not None
        assert drawn.depth is not None
        before = torch.cat([drawn.image, drawn.mask], 1)
        hidden = torch.cat([before, drawn.depth], 1)
        styles = style.split([layer.affine.out_features for layer in self.styles], 1)  # type: ignore[misc, union-attr]
        for convolution, layer, part in zip(self.features, self.styles, styles, strict=True):
            hidden = F.leaky_relu(layer(convolution(hidden), part), 0.2)
        residual = self.output(hidden).to(before.dtype)
        image, mask = torch.sigmoid(torch.logit(before, MARGIN) + residual).split([3, 1], 1)
        return Rendering(image, mask, drawn.depth)
