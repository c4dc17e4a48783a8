"""Per-pixel weights, as all energies use them."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from kfit.core.check import check_shape


def normalized_weights(weight: Tensor | None, like: Tensor) -> Tensor:
    """Normalize weights so that each row's sum over channels and pixels is 1: w / (C · Σ_pixels w).

    A row whose weights are all 0 gets weights of 0, and with them an energy of 0.

    Args:
        weight: (N, 1, H, W), not negative, resized by area to the size of ``like``; None weighs all pixels alike.
        like: (N, C, h, w), or for volumes (N, C, d, h, w).

    Returns:
        (N, 1, h, w), or (N, 1, 1, 1) if ``weight`` is None; float32 at least.

    Raises:
        ValueError: if ``weight`` has another shape or number of rows.
    """
    dtype = torch.promote_types(like.dtype, torch.float32)
    if weight is None:
        shape = (like.shape[0], *[1] * (like.dim() - 1))
        return torch.full(shape, 1 / like[0].numel(), dtype=dtype, device=like.device)
    check_shape("weight", weight, (like.shape[0], 1, *"DHW"[-(like.dim() - 2) :]))
    weight = weight.to(dtype)
    if weight.shape[2:] != like.shape[2:]:
        weight = F.interpolate(weight, list(like.shape[2:]), mode="area")
    total = like.shape[1] * weight.sum(tuple(range(1, like.dim())), keepdim=True)
    return weight / torch.where(total > 0, total, 1)


def root_weights(weight: Tensor | None, like: Tensor) -> Tensor:
    """Return square roots of `normalized_weights`, which turn differences into residuals; at 0 their slope is 0 too."""
    share = normalized_weights(weight, like)
    counted = share > 0
    return torch.where(counted, torch.where(counted, share, 1).sqrt(), 0)


def fill_background(image: Tensor, weight: Tensor | None) -> Tensor:
    """Return ``image`` (N, C, H, W) with white, the background, where ``weight`` (N, 1, H, W) is 0.

    Hidden pixels may hold anything, NaN too. Filling both sides alike removes them from sums, and from the windows and
    receptive fields of their neighbours, so that a partly hidden object still has its least energy at the truth.
    """
    return image if weight is None else torch.where(weight > 0, image, 1.0)
