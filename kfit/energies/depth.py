"""Depth against depth."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from kfit.core import Energy
from kfit.core.check import check_shape
from kfit.energies.pixel import L1


class Depth(Energy):
    """How far two depth maps differ where the target is known, by an energy of single pixels: `L1` unless given.

    Pixels whose target is NaN or infinite count no more than those of weight 0. Both maps are compared in one unit: a
    sensor's 0 for "unknown" must be told by the weight or replaced by NaN. Where pixels of something else may be among
    the target's, such as of the ground behind the object, ``Depth(GemanMcClure(0.01))`` bounds what they cost.

    Shape: depths (N, 1, H, W), weight (N, 1, H, W), energy (N,): with `L1` in the unit of the depths.

    Args:
        energy: of two pictures of one channel, with a weight by pixel.

    Raises:
        ValueError: if the shapes differ.

    >>> import torch
    >>> Depth()(torch.tensor([[[[1.0, 2.0, 3.0]]]]), torch.tensor([[[[1.5, torch.nan, 3.0]]]]))
    tensor([0.2500])
    """

    on = "depth"
    volumes = False

    def __init__(self, energy: Energy | None = None) -> None:
        super().__init__()
        self.energy = L1() if energy is None else energy

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        check_shape("target", target, ("N", 1, "H", "W"))
        known = target.isfinite()
        if weight is not None:
            check_shape("weight", weight, tuple(target.shape))
        weight = known.to(target) if weight is None else weight * known
        return self.energy.prepare(target.where(known, 0), weight)

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        return self.energy.compare(prediction, prepared)
