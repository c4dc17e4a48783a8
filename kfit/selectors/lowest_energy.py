"""The start that explains the picture best."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import Selector, Variables


class LowestEnergy(Selector):
    """Picks the row of lowest energy; of equals the first."""

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        # Sorting by energy and then, stably, by problem puts each problem's winner first in its run.
        by_energy = energy.argsort(stable=True)
        order = by_energy[problem[by_energy].argsort(stable=True)]
        counts = torch.bincount(problem)
        return order[counts.cumsum(0) - counts]
