"""A vote of the best starts on the rotation."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core import Selector, Variables
from kfit.core.arguments import check_arguments
from kfit.geometry.pose import rotation_error, rotation_of
from kfit.geometry.symmetry import Symmetry, check_symmetry


class RotationVote(Selector):
    """Let the best starts vote on the rotation, as in the released code (neural_object_fitting@7309348 eval.py).

    Each of the ``top`` rows of lowest energy counts those within ``within_deg`` of it. The row with most votes wins,
    and the row of lowest energy among its voters is selected.

    Args:
        symmetry: ``"y"`` compares vertical axes only.
        top: number of voters.
        within_deg: degrees within which two rotations agree.

    Raises:
        ValueError: if there are no voters, the angle is negative, or the symmetry is unknown.

    Example:
        >>> import torch
        >>> from kfit.selectors import RotationVote
        >>> energy, problem = torch.tensor([0.300, 0.200, 0.205, 0.210]), torch.zeros(4, dtype=torch.long)
        >>> azimuth = torch.tensor([0.0, 3.0, 1.0, 1.1])  # two good starts agree, the best is alone
        >>> RotationVote()(energy, {"azimuth": azimuth, "elevation": torch.zeros(4)}, problem)
        tensor([2])
    """

    def __init__(self, symmetry: Symmetry = "none", top: int = 5, within_deg: float = 10.0) -> None:
        check_arguments(RotationVote, locals(), symmetry=(check_symmetry,), within_deg=(0, 180))
        self.symmetry, self.top, self.within = symmetry, top, math.radians(within_deg)

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        rotation = rotation_of(values)
        winners = []
        for number in range(int(problem.max()) + 1):
            rows = (problem == number).nonzero()[:, 0]
            rows = rows[energy[rows].argsort(stable=True)][: self.top]
            apart = rotation_error(rotation[rows][:, None], rotation[rows][None], self.symmetry)
            agree = apart <= self.within
            best = agree.sum(1).argmax()  # the first of equal counts has the lowest energy
            winners.append(rows[int(agree[best].nonzero()[0])])
        return torch.stack(winners)
