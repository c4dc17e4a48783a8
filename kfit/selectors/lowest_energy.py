"""The start that explains the picture best."""

from __future__ import annotations

from torch import Tensor

from kfit.core import Selector, Variables
from kfit.core.rows import best_first


class LowestEnergy(Selector):
    """Picks the row of lowest energy; of equals the first."""

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        order, place = best_first(energy, problem)
        return order[place == 0]
