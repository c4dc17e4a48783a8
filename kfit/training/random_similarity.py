"""Augmentation by small rotations, shifts and scales."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core import Rendering
from kfit.core.arguments import check_arguments
from kfit.generators.similarity_warp import warp


class RandomSimilarity:
    """Rotate, shift and scale pictures at random by `kfit.generators.SimilarityWarp`'s warp, white outside.

    Crops of photos centre the object's outline and fill the frame with it, while a generator's views centre the
    object's box and keep its size; an encoder trained on jittered views handles both.

    Args:
        roll_deg: largest rotation.
        shift: largest shift, in half-widths.
        scale: largest factor; sizes are log-uniform between its inverse and itself.

    Raises:
        ValueError: if the rotation or shift is negative, or the factor below 1.
    """

    def __init__(self, roll_deg: float = 15.0, shift: float = 0.15, scale: float = 1.25) -> None:
        check_arguments(RandomSimilarity, locals(), roll_deg=(0, 180), shift=(0, 1), scale=(1, 4))
        self.roll, self.shift, self.scale = math.radians(roll_deg), shift, scale

    def __call__(self, image: Tensor) -> Tensor:
        """(N, 3, S, S) on white → the same, each picture its own way, drawn from torch's random numbers."""
        even = 2 * torch.rand(len(image), 4, device=image.device, dtype=image.dtype) - 1
        return warp(
            Rendering(image),
            roll=self.roll * even[:, 0],
            shift=self.shift * even[:, 1:3],
            scale=torch.exp(math.log(self.scale) * even[:, 3]),
        ).image
