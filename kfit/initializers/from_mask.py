"""The position of the object from its mask."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables


class FromMask(Initializer):
    """Start the shift of `kfit.generators.SimilarityWarp` at the middle of the observed mask's bounding box.

    It serves pictures that are not cropped around their object; in cropped ones it starts within a pixel of 0. The box
    holds the pixels with a mask above 1/2. Shifts are in half-widths of the picture, right and up. An empty mask starts
    at 0.

    Raises:
        ValueError: when called, if the observation has no mask.

    Example:
        >>> import torch
        >>> from kfit.core import Observation, Variable
        >>> from kfit.initializers import FromMask
        >>> mask = torch.zeros(1, 1, 64, 64)
        >>> mask[..., 0:16, 48:64] = 1  # the upper right corner
        >>> FromMask()({"shift": Variable((2,))}, Observation(torch.ones(1, 3, 64, 64), mask), 1, [])["shift"]
        tensor([[0.7500, 0.7500]])
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
    """Return the middle (N,) between the first and the last set pixel of (N, L), in pixels from the centre."""
    length = inside.shape[1]
    first, last = inside.int().argmax(1), length - 1 - inside.int().flip(1).argmax(1)
    return torch.where(inside.any(1), (first + last + 1 - length) / 2, 0.0)
