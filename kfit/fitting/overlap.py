"""The overlap of a rendering and an observation."""

from __future__ import annotations

import torch
from torch import Tensor


def joint_weight(drawn: Tensor, observed: Tensor | None) -> Tensor:
    """Multiply a rendering's weight (N, 1, H, W) by the observation's; None is 1 everywhere.

    Where the product is 0 its slope is set to 0, because the square root of a weight has an infinite slope there.
    """
    joint = drawn if observed is None else drawn * observed
    return joint.masked_fill(joint == 0, 0)


def overlap_of(joint: Tensor, observed: Tensor | None) -> Tensor:
    """Compute the overlap Σ joint / Σ observed, (N,) in [0, 1]; 0 if the observation's weight is 0 everywhere.

    Args:
        joint: the result of `joint_weight`.
        observed: the observation's weight.
    """
    if observed is None:
        return joint.flatten(1).mean(1)
    total = observed.to(joint).flatten(1).sum(1)
    return joint.flatten(1).sum(1) / torch.where(total > 0, total, 1)


def too_little(overlap: Tensor, least: float) -> Tensor:
    """Return which rows (N,) overlap less than ``least``, or not at all."""
    return (overlap < least) | (overlap <= 0)


def shortfall(overlap: Tensor, least: float) -> Tensor:
    """Return the fraction (N,) that is missing to the least overlap, from 0 to 1."""
    return (1 - overlap / least).clamp_min(0) if least else torch.zeros_like(overlap)
