"""What a rendering and an observation both count, and rows of which that is too little."""

from __future__ import annotations

import torch
from torch import Tensor


def joint_weight(drawn: Tensor, observed: Tensor | None) -> Tensor:
    """The product (N, 1, H, W) of a rendering's weight and the observation's; None counts all pixels alike.

    Where it is 0 it has no slope, as roots of weights would have an infinite one there.
    """
    joint = drawn if observed is None else drawn * observed
    return joint.masked_fill(joint == 0, 0)


def overlap_of(joint: Tensor, observed: Tensor | None) -> Tensor:
    """What is counted of what the observation counts: Σ joint / Σ observed, (N,) in [0, 1]; 0 where it counts nothing.

    Args:
        joint: as `joint_weight` gives it.
        observed: the observation's weight.
    """
    if observed is None:
        return joint.flatten(1).mean(1)
    total = observed.to(joint).flatten(1).sum(1)
    return joint.flatten(1).sum(1) / torch.where(total > 0, total, 1)


def too_little(overlap: Tensor, least: float) -> Tensor:
    """Which rows (N,) overlap less than ``least``, or not at all."""
    return (overlap < least) | (overlap <= 0)


def shortfall(overlap: Tensor, least: float) -> Tensor:
    """The share (N,) that is missing of the least overlap, from 0 to 1."""
    return (1 - overlap / least).clamp_min(0) if least else torch.zeros_like(overlap)
