"""How unlikely a network finds it that a drawing shows the photo's object at its pose."""

from __future__ import annotations

from typing import Any

from torch import Tensor
from torch.nn import functional as F

from kfit.core import Energy
from kfit.geometry import RefinerNetwork, refiner_input


class LearnedScore(Energy):
    """Ranks hypotheses by a network: E = −ln σ(l), with the log-odds l that the drawn rotation is right.

    It is meant for ranking (``rank_weights``): it says which of several poses is right, not which way is down.

    Shape: images (N, 3, H, W) and masks (N, 1, H, W), energy (N,), above 0. Pixels of weight 0 are white in both.

    Args:
        refiner: as `kfit.features.PoseRefiner`.

    Example:
        >>> import torch
        >>> from kfit.features import PoseRefiner
        >>> score = LearnedScore(PoseRefiner(None).eval())  # untrained: all poses may as well be right as wrong
        >>> pictures = {"image": torch.rand(1, 3, 64, 64), "mask": torch.ones(1, 1, 64, 64)}
        >>> score(pictures, pictures).detach()
        tensor([0.6931])
    """

    on = ("image", "mask")

    def __init__(self, refiner: RefinerNetwork) -> None:
        super().__init__()
        self.refiner = refiner

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        prepared_inputs = {"observed": refiner_input(target["image"], target["mask"], weight)}
        return prepared_inputs if weight is None else prepared_inputs | {"weight": weight}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        drawn = refiner_input(prediction["image"], prediction["mask"], prepared.get("weight"))
        return F.softplus(-self.refiner(prepared["observed"], drawn).logit)
