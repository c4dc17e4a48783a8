"""Peak signal-to-noise ratio."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from kfit.core import Energy
from kfit.energies.pixel import L2
from kfit.energies.weighting import normalized_weights

# Limits the ratio of equal pictures, which would be infinite, to 100 dB.
_LEAST_SQUARE = 1e-10


class PSNR(Energy):
    """Negative peak signal-to-noise ratio of a picture, in decibels.

    E = 10 · log10(MSE + 1e-10), with the MSE of `L2` and a peak of 1: −100 for equal pictures, 0 for opposite ones and
    for rows whose weights are all 0.

    Shape: pictures (N, C, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in dB; volumes (N, C, D, H, W) too.

    Raises:
        ValueError: if the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import PSNR
        >>> PSNR()(torch.full((1, 3, 4, 4), 0.5), torch.full((1, 3, 4, 4), 0.6))
        tensor([-20.0000])
    """

    volumes = True
    unit_range = True

    def __init__(self) -> None:
        super().__init__()
        self.square = L2()

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        counted = normalized_weights(weight, target).flatten(1).sum(1) > 0
        return {"square": self.square.prepare(target, weight), "counted": counted}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        square = self.square.compare(prediction, prepared["square"])
        return torch.where(prepared["counted"], 10 * (square + _LEAST_SQUARE).log10(), 0)
