"""An energy of depth maps."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from kfit.core import Energy
from kfit.core.check import check_shape
from kfit.energies.pixel import L1


class Depth(Energy):
    """Difference of two depth maps where the target is known, measured by an energy of single pixels (default: `L1`).

    Pixels whose target is NaN or infinite are ignored, like pixels of weight 0. Both maps must have the same unit. A
    sensor that writes 0 for "unknown" needs NaN or a weight of 0 there. If pixels of another surface may be among the
    target's, such as the ground behind the object, ``Depth(GemanMcClure(0.01))`` bounds their cost.

    Shape: depths (N, 1, H, W), weight (N, 1, H, W), energy (N,); with `L1` in the unit of the depths.

    Args:
        energy: an energy of pictures with one channel that takes a weight by pixel.

    Raises:
        ValueError: if the shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import Depth
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
