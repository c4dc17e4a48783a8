"""The start that most of the best starts agree with."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core import Selector, Variables
from kfit.core.check import check_count, check_range
from kfit.geometry.pose import rotation_error, rotation_of
from kfit.geometry.symmetry import Symmetry, check_symmetry


class RotationVote(Selector):
    """Lets the best starts vote on the rotation, as the released code does (neural_object_fitting@7309348 eval.py).

    Of the ``top`` rows of lowest energy, each counts those within ``within_deg`` of it; the one with most wins, and
    its lowest-energy supporter is the answer.

    Args:
        symmetry: ``"y"`` compares vertical axes only.
        top: voters.
        within_deg: degrees within which two rotations agree.

    Raises:
        ValueError: for no voters, a negative angle, or a symmetry of another name.
    """

    def __init__(self, symmetry: Symmetry = "none", top: int = 5, within_deg: float = 10.0) -> None:
        check_symmetry("RotationVote: symmetry", symmetry)
        check_count("RotationVote: top", top)
        check_range("RotationVote: within_deg", within_deg, 0, 180)
        self.symmetry, self.top, self.within = symmetry, top, math.radians(within_deg)

    def __call__(self, energy: Tensor, values: Variables, problem: Tensor) -> Tensor:
        rotation = rotation_of(values)
        winners = []
        for number in range(int(problem.max()) + 1):
            rows = (problem == number).nonzero()[:, 0]
            rows = rows[energy[rows].argsort(stable=True)][: self.top]
            apart = rotation_error(rotation[rows][:, None], rotation[rows][None], self.symmetry)
            agree = apart <= self.within
            best = agree.sum(1).argmax()  # of equal counts the first, which has the lower energy
            winners.append(rows[int(agree[best].nonzero()[0])])
        return torch.stack(winners)
