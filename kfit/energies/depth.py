"""Depth against depth."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from kfit.core.check import check_shape
from kfit.energies.pixel import L1


class Depth(L1):
    """Mean absolute difference of two depth maps where the target is known: `L1` on "depth".

    E = Σ_p w_p · |x_p − y_p| / Σ_p w_p over the pixels whose target is finite; those that are NaN or infinite count no
    more than those of weight 0. Both maps are compared in one unit: a sensor's 0 for "unknown" must be told by the
    weight or replaced by NaN.

    Shape: depths (N, 1, H, W), weight (N, 1, H, W), energy (N,) in the unit of the depths.

    Raises:
        ValueError: if the shapes differ.
    """

    on = "depth"
    volumes = False

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        check_shape("target", target, ("N", 1, "H", "W"))
        known = target.isfinite()
        if weight is not None:
            check_shape("weight", weight, tuple(target.shape))
        return super().prepare(target.where(known, 0), known.to(target) if weight is None else weight * known)
