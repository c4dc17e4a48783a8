"""Where a segmentation saw the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables


class FromMask(Initializer):
    """Starts `kfit.generators.SimilarityWarp`'s shift at the middle of the observed mask's box.

    For pictures that are not cut out around their object; in those that are, it starts within a pixel of 0. The box
    holds the pixels with a mask above ½; shifts are in half-widths of the picture, right and up. An empty mask starts
    at 0.

    Raises:
        ValueError: when it is called, for an observation without a mask.
    """

    on = ("shift",)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        inside = observation.field("mask")[:, 0] > 0.5
        width = inside.shape[2]
        right, up = _middle(inside.any(1)) / (width / 2), -_middle(inside.any(2)) / (width / 2)
        shift = torch.stack([right, up], 1).to(observation.image)
        return {"shift": shift.repeat_interleave(num_starts, 0)}


def _middle(inside: Tensor) -> Tensor:
    """(N, L) → (N,) middle between the first and the last that is seen, in pixels from the middle of all."""
    length = inside.shape[1]
    first, last = inside.int().argmax(1), length - 1 - inside.int().flip(1).argmax(1)
    return torch.where(inside.any(1), (first + last + 1 - length) / 2, 0.0)
