"""An energy of one's own: the mean difference over the pixels that fit best."""

from typing import Any

from torch import Tensor

from kfit.core import Energy


class TrimmedL1(Energy):
    """E = mean of the ``share`` of pixels whose absolute difference is least: what does not fit at all does not count.

    Args:
        share: in (0, 1].
    """

    def __init__(self, share: float = 0.9) -> None:
        super().__init__()
        self.share = share

    def compare(self, prediction: Tensor, prepared: Any) -> Tensor:
        away = (prediction - prepared["target"]).abs()
        if "weight" in prepared:
            away = away * prepared["weight"]
        away = away.flatten(1)
        return away.topk(int(self.share * away.shape[1]), dim=1, largest=False).values.mean(1)
