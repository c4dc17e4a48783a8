"""Every shipped selector through one suite; a new one fails until the table below says how to build it."""

import math

import pytest
import torch
from walk import shipped

import kfit.selectors
from kfit.core import Selector
from kfit.selectors import Clusters, LowestEnergy, RotationVote

BUILD = {
    Clusters: [Clusters, lambda: Clusters("y", within_deg=5.0), lambda: Clusters(temperature=10.0)],
    LowestEnergy: [LowestEnergy],
    RotationVote: [RotationVote, lambda: RotationVote("y", top=3), lambda: RotationVote(top=1, within_deg=0.0)],
}
built = [
    pytest.param(build, id=f"{kind.__name__}-{number}") for kind in BUILD for number, build in enumerate(BUILD[kind])
]


def rows(seed=0, counts=(5, 1, 7, 2)):
    """Problems with different numbers of rows, in any order."""
    rng = torch.Generator().manual_seed(seed)
    problem = torch.cat([torch.full((count,), number) for number, count in enumerate(counts)])
    problem = problem[torch.randperm(len(problem), generator=rng)]
    values = {name: torch.rand(len(problem), generator=rng) for name in ("azimuth", "elevation", "roll")}
    return torch.rand(len(problem), generator=rng), values, problem


def test_every_shipped_selector_is_covered_here_and_exported():
    found = shipped(kfit.selectors, Selector)
    assert found == set(BUILD)
    assert {kind.__name__ for kind in found} <= set(kfit.selectors.__all__)


@pytest.mark.parametrize("build", built)
class TestASelector:
    def test_picks_a_row_of_each_problem(self, build):
        energy, values, problem = rows()
        winner = build()(energy, values, problem)
        assert winner.dtype == torch.long
        assert problem[winner].tolist() == [0, 1, 2, 3]

    def test_picks_the_same_rows_whatever_their_order(self, build):
        for seed in range(5):
            energy, values, problem = rows(seed)
            order = torch.randperm(len(problem), generator=torch.Generator().manual_seed(seed + 50))
            rotated = build()(energy[order], {name: value[order] for name, value in values.items()}, problem[order])
            assert order[rotated].tolist() == build()(energy, values, problem).tolist()

    def test_judges_each_problem_alone(self, build):
        energy, values, problem = rows()
        winner = build()(energy, values, problem)
        for number in range(4):
            own = (problem == number).nonzero()[:, 0]
            alone = build()(energy[own], {n: v[own] for n, v in values.items()}, torch.zeros(len(own)).long())
            assert own[alone].tolist() == [int(winner[number])]


def test_the_lowest_energy_wins_and_of_equals_the_first():
    energy = torch.tensor([3.0, 1.0, 2.0, 1.0, 5.0, 4.0])
    problem = torch.tensor([0, 0, 1, 0, 1, 2])
    assert LowestEnergy()(energy, {}, problem).tolist() == [1, 2, 5]


def rotation_by(azimuth_deg, elevation_deg=None):
    azimuth = torch.tensor(azimuth_deg, dtype=torch.float64).deg2rad()
    return {
        "azimuth": azimuth,
        "elevation": torch.tensor(elevation_deg or [0.0] * len(azimuth), dtype=torch.float64).deg2rad(),
    }


class TestARotationVote:
    energy = torch.tensor([0.1, 0.4, 0.2, 0.3, 0.5, 0.6])
    problem = torch.zeros(6, dtype=torch.long)

    def test_lets_the_majority_win_over_the_lowest_energy(self):
        # Rows 1, 2 and 3 look the same way; row 2 is the best of them. Row 0 is better still, and alone.
        values = rotation_by([90.0, 4.0, 0.0, -4.0, 200.0, 90.0])
        assert RotationVote()(self.energy, values, self.problem).tolist() == [2]

    def test_hears_only_the_best(self):
        # Of three voters 0, 2 and 3, two agree; with all six the three at 120° do.
        values = rotation_by([120.0, 120.0, 0.0, 4.0, 120.0, 240.0])
        assert RotationVote(top=3)(self.energy, values, self.problem).tolist() == [2]
        assert RotationVote(top=6)(self.energy, values, self.problem).tolist() == [0]

    def test_the_winner_s_best_supporter_is_the_answer(self):
        # Row 3 at 9° has most within 10°: rows 2 (0°) and 1 (18°) do not see each other. Its best supporter is row 2.
        values = rotation_by([90.0, 18.0, 0.0, 9.0, 200.0, 270.0])
        assert RotationVote()(self.energy, values, self.problem).tolist() == [2]

    def test_between_equals_the_lower_energy_wins(self):
        values = rotation_by([90.0, 0.0, 180.0, 270.0, 45.0, 135.0])
        assert RotationVote()(self.energy, values, self.problem).tolist() == [0]

    def test_a_symmetric_class_is_evaluated_by_its_axis_alone(self):
        # All azimuths differ; rows 1, 3 and 4 tip alike, which only the symmetric vote can see.
        values = rotation_by([0.0, 60.0, 120.0, 180.0, 240.0, 300.0], [50.0, 2.0, 80.0, 0.0, 1.0, 70.0])
        assert RotationVote("y")(self.energy, values, self.problem).tolist() == [3]
        assert RotationVote()(self.energy, values, self.problem).tolist() == [0]

    def test_turns_around_the_circle_agree(self):
        values = rotation_by([90.0, 179.0, -179.0, 541.0, 0.0, 45.0])
        assert RotationVote()(self.energy, values, self.problem).tolist() == [2]

    def test_hears_roll_where_there_is_one(self):
        values = rotation_by([90.0, 0.0, 0.0, 0.0, 200.0, 270.0])
        values["roll"] = torch.tensor([0.0, 0.0, 90.0, 0.0, 0.0, 0.0], dtype=torch.float64).deg2rad()
        assert RotationVote()(self.energy, values, self.problem).tolist() == [3]

    def test_every_row_agrees_with_itself_though_rounding_says_otherwise(self):
        rng = torch.Generator().manual_seed(0)
        values = {name: 6 * torch.rand(6, generator=rng) - math.pi for name in ("azimuth", "elevation", "roll")}
        assert RotationVote(within_deg=0.0)(self.energy, values, self.problem).tolist() == [0]

    @pytest.mark.parametrize("settings", [{"top": 0}, {"within_deg": -1.0}])
    def test_refuses_no_voters_and_negative_angles(self, settings):
        with pytest.raises(
            ValueError, match=r"RotationVote: (top must be at least 1|within_deg must lie between 0 and 180)"
        ):
            RotationVote(**settings)

    def test_refuses_a_symmetry_of_another_name_when_it_is_built(self):
        with pytest.raises(ValueError, match="symmetry must be one of none, y, y2"):
            RotationVote("z")
