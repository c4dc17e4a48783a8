"""The start with the lowest energy."""

from __future__ import annotations

from torch import Tensor

from kfit.core import Selector, Variables
from kfit.core.rows import best_first


class LowestEnergy(Selector):
    """Select the row of lowest energy; the first one of equals.

    Example:
        >>> import torch
        >>> from kfit.selectors import LowestEnergy
        >>> energy, problem = torch.tensor([0.3, 0.1, 0.2, 0.4]), torch.tensor([0, 0, 1, 1])
        >>> LowestEnergy()(energy, {}, problem)  # the winning rows of problems 0 and 1
        tensor([1, 2])
    """

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        order, place = best_first(energy, problem)
        return order[place == 0]
