"""Rows that a refiner learns from: pictures, drawings, and what is to be predicted; and a memory of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from kfit.geometry.refiner_network import PoseUpdate

# Updates are learned from hypotheses nearer than this: beyond, a flipped object would pull both ways.
REACH_DEG = 45.0
# A hypothesis is right where it is about as near as RIGHT_DEG; log-odds fall by 1 every SOFT_DEG.
RIGHT_DEG, SOFT_DEG = 15.0, 4.0


class RefinerRows(NamedTuple):
    """Pictures and drawings with the updates that would take the drawn poses to the true ones.

    Attributes:
        observed, drawn: (N, 4, S, S) pictures and masks.
        up: (N, 3) the drawn objects' vertical axes.
        rotation, shift, log_scale: (N, 3), (N, 2) and (N,) the updates, see `kfit.geometry.PoseUpdate`.
        error: (N,) angles between drawn and true rotations in radians.
        free_turn: (N,) 1 where the object looks the same turned about its vertical axis, else 0.
    """

    observed: Tensor
    drawn: Tensor
    up: Tensor
    rotation: Tensor
    shift: Tensor
    log_scale: Tensor
    error: Tensor
    free_turn: Tensor

    def join(self, *others: RefinerRows) -> RefinerRows:
        """These and others."""
        return RefinerRows(*map(torch.cat, zip(self, *others, strict=True)))

    def mirrored(self, rows: Tensor) -> RefinerRows:
        """The same with the pictures of ``rows`` (N,), boolean, seen in a mirror.

        There a rotation about x stays and those about y and z turn to the other side.
        """

        def flipped(tensor: Tensor, signs: tuple[float, ...]) -> Tensor:
            return torch.where(rows[:, None], tensor * tensor.new_tensor(signs), tensor)

        pictures = {
            name: torch.where(rows[:, None, None, None], tensor.flip(3), tensor)
            for name, tensor in (("observed", self.observed), ("drawn", self.drawn))
        }
        return self._replace(
            **pictures,
            up=flipped(self.up, (-1, 1, 1)),
            rotation=flipped(self.rotation, (1, -1, -1)),
            shift=flipped(self.shift, (-1, 1)),
        )

    def losses(self, found: PoseUpdate) -> dict[str, Tensor]:
        """Losses of predictions, each one number.

        Of the updates they are negative log-likelihoods of Laplace distributions, Σ_k |x_k − μ_k| / b + k · ln b: so
        updates are medians, which a hidden handle leaves at 0, and b is the expected error. Rotations count apart
        along the vertical axis and across it. The logit learns, by its cross-entropy, the share of right ones,
        1 / (1 + exp((error − 15°) / 4°)).
        """
        near = (self.error < math.radians(REACH_DEG)).to(self.error)
        off = found.rotation - self.rotation
        along = (off * self.up).sum(1)
        across = (off - along[:, None] * self.up).square().sum(1).add(1e-8).sqrt()
        log_error = found.log_error
        tilt = across * (-log_error[:, 0]).exp() + 2 * log_error[:, 0]
        turn = along.abs() * (-log_error[:, 1]).exp() + log_error[:, 1]
        place = (found.shift - self.shift).square().sum(1).add(1e-8).sqrt() * (-log_error[:, 2]).exp() + 2 * log_error[
            :, 2
        ]
        size = (found.log_scale - self.log_scale).abs() * (-log_error[:, 3]).exp() + log_error[:, 3]
        right = torch.sigmoid((RIGHT_DEG - self.error.rad2deg()) / SOFT_DEG)
        turns = near * (1 - self.free_turn)
        return {
            "tilt": (near * tilt).sum() / near.sum().clamp_min(1),
            "turn": (turns * turn).sum() / turns.sum().clamp_min(1),
            "shift": (near * place).sum() / near.sum().clamp_min(1),
            "scale": (near * size).sum() / near.sum().clamp_min(1),
            "right": F.binary_cross_entropy_with_logits(found.logit, right),
        }


class RefinerMemory:
    """The latest rows, of which any may be learned from again.

    Pictures are kept in 8 bits.

    Args:
        size: largest number of rows.
    """

    def __init__(self, size: int) -> None:
        self.size, self.next, self.count = size, 0, 0
        self.held: RefinerRows | None = None

    def add(self, rows: RefinerRows) -> None:
        """Keep rows, instead of the oldest where there is no room."""
        small = rows._replace(observed=_to_bytes(rows.observed), drawn=_to_bytes(rows.drawn))
        if self.held is None:
            self.held = RefinerRows(*(tensor.new_zeros(self.size, *tensor.shape[1:]) for tensor in small))
        place = (self.next + torch.arange(len(rows.error), device=rows.error.device)) % self.size
        for held, tensor in zip(self.held, small, strict=True):
            held[place] = tensor
        self.next = (self.next + len(rows.error)) % self.size
        self.count = min(self.size, self.count + len(rows.error))

    def sample(self, count: int) -> RefinerRows:
        """Any ``count`` of the rows, by torch's random numbers."""
        assert self.held is not None  # rows were added
        place = torch.randint(self.count, (count,), device=self.held.error.device)
        rows = RefinerRows(*(tensor[place] for tensor in self.held))
        return rows._replace(observed=rows.observed.float() / 255, drawn=rows.drawn.float() / 255)


def _to_bytes(pictures: Tensor) -> Tensor:
    return (255 * pictures.clamp(0, 1)).round().to(torch.uint8)
