"""An energy of one's own: the mean difference over the pixels that fit best."""

from typing import Any

import torch
from torch import Tensor

from kfit import Energy


class TrimmedL1(Energy):
    """E = mean of the ``share`` of pixels whose absolute difference is least: what does not fit at all does not count.

    With weights, the share is one of the weight that there is, and pixels of weight 0 are never among the best.

    Args:
        share: in (0, 1].
    """

    def __init__(self, share: float = 0.9) -> None:
        super().__init__()
        self.share = share

    def prepare(self, target: Tensor, weight: Tensor | None = None) -> Any:
        weight = torch.ones_like(target[:, :1]) if weight is None else weight.to(target)
        return {"target": torch.where(weight > 0, target, 0), "weight": weight}

    def compare(self, prediction: Tensor, prepared: Any) -> Tensor:
        weight: Tensor = prepared["weight"]
        # hidden pixels may be NaN: they are replaced on both sides, and come last
        away: Tensor = (torch.where(weight > 0, prediction, 0) - prepared["target"]).abs()
        weight = weight.expand_as(away).flatten(1)
        order = torch.where(weight > 0, away.flatten(1), torch.inf).argsort(1)
        away, weight = away.flatten(1).gather(1, order), weight.gather(1, order)
        before = weight.cumsum(1) - weight
        kept = weight * (before < self.share * weight.sum(1, keepdim=True))
        return (away * kept).sum(1) / kept.sum(1).clamp_min(1e-12)
