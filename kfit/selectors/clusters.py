"""The rotation with the largest total weight of starts."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import Selector, Variables
from kfit.core.arguments import check_arguments
from kfit.geometry.clusters import TEMPERATURE, WITHIN_DEG, energy_weights, rotation_clusters
from kfit.geometry.pose import rotation_of
from kfit.geometry.symmetry import Symmetry, check_symmetry


class Clusters(Selector):
    """Group each problem's rows by rotation and select the best row of the group of largest weight.

    A row weighs exp(−(E − E_best) / (temperature · E_best)), a group the sum of its rows, so both many and good starts
    count. As ``temperature`` falls to 0 the lowest energy decides, as it rises the number of starts.

    Args:
        symmetry: ``"y"`` ignores rotations about the vertical axis.
        within_deg: largest angle of a row from the best one of its group.
        temperature: relative to the lowest energy.

    Raises:
        ValueError: if the symmetry is unknown, the angle is outside 0° to 180°, or the temperature is not above 0.

    Example:
        >>> import torch
        >>> from kfit.selectors import Clusters
        >>> energy, problem = torch.tensor([0.300, 0.200, 0.205, 0.210]), torch.zeros(4, dtype=torch.long)
        >>> azimuth = torch.tensor([0.0, 3.0, 1.0, 1.1])  # two good starts agree, the best is alone
        >>> Clusters()(energy, {"azimuth": azimuth, "elevation": torch.zeros(4)}, problem)
        tensor([2])
    """

    def __init__(
        self, symmetry: Symmetry = "none", within_deg: float = WITHIN_DEG, temperature: float = TEMPERATURE
    ) -> None:
        check_arguments(Clusters, locals(), symmetry=(check_symmetry,), within_deg=(0, 180), temperature=(1e-6, 1e6))
        self.symmetry, self.within_deg, self.temperature = symmetry, within_deg, temperature

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        rotation = rotation_of(values)
        winners = []
        for number in range(int(problem.max()) + 1):
            rows = (problem == number).nonzero()[:, 0]
            rows = rows[energy[rows].argsort(stable=True)]
            cluster = rotation_clusters(rotation[rows], energy[rows], self.symmetry, self.within_deg)
            weight = energy_weights(energy[rows], self.temperature)
            # argmax takes the first of equal groups, whose best row is better.
            heaviest = torch.zeros_like(weight).index_add(0, cluster, weight).argmax()
            winners.append(rows[int((cluster == heaviest).nonzero()[0])])
        return torch.stack(winners)
