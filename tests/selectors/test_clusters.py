from __future__ import annotations

import pytest
import torch
from torch import Tensor

from kfit.selectors import Clusters

PROBLEM = torch.zeros(6, dtype=torch.long)


def rotated(azimuth_deg: list[float], elevation_deg: list[float] | None = None) -> dict[str, Tensor]:
    azimuth = torch.tensor(azimuth_deg, dtype=torch.float64).deg2rad()
    elevation = torch.tensor(elevation_deg or [0.0] * len(azimuth), dtype=torch.float64).deg2rad()
    return {"azimuth": azimuth, "elevation": elevation}


def test_many_good_starts_win_over_a_single_one_a_little_better() -> None:
    energy = torch.tensor([1.00, 1.03, 1.01, 1.02, 1.30, 1.30])
    values = rotated([90, 5, 0, -5, 180, 270])
    assert Clusters()(energy, values, PROBLEM).tolist() == [2]


def test_a_start_that_is_much_better_wins_over_any_number() -> None:
    energy = torch.tensor([1.0, 2.0, 2.0, 2.0, 2.0, 2.0])
    assert Clusters()(energy, rotated([90, 5, 0, -5, 0, 3]), PROBLEM).tolist() == [0]


def test_the_temperature_decides_between_number_and_energy() -> None:
    energy = torch.tensor([1.0, 1.2, 1.2, 1.2, 1.5, 1.5])
    values = rotated([90, 5, 0, -5, 180, 270])
    assert Clusters(temperature=0.01)(energy, values, PROBLEM).tolist() == [0]
    assert Clusters(temperature=1.0)(energy, values, PROBLEM).tolist() == [1]


def test_energies_count_relative_to_the_best() -> None:
    energy = torch.tensor([1.00, 1.08, 1.05, 1.07, 1.30, 1.30])
    values = rotated([90, 5, 0, -5, 180, 270])
    assert Clusters()(energy, values, PROBLEM).tolist() == Clusters()(1000 * energy, values, PROBLEM).tolist()


def test_a_symmetric_class_is_grouped_by_its_axis_alone() -> None:
    # All azimuths differ; rows 1, 3 and 4 tip alike, which only the symmetric grouping can see.
    energy = torch.tensor([1.00, 1.02, 1.02, 1.01, 1.03, 1.02])
    values = rotated([0, 60, 120, 180, 240, 300], [60, 2, 80, 0, 1, 30])
    assert Clusters("y", within_deg=10)(energy, values, PROBLEM).tolist() == [3]
    assert Clusters(within_deg=10)(energy, values, PROBLEM).tolist() == [0]


def test_hears_roll_where_there_is_one() -> None:
    energy = torch.tensor([1.00, 1.01, 1.01, 1.01, 1.5, 1.5])
    values = rotated([0, 0, 0, 0, 180, 270])
    values["roll"] = torch.tensor([90.0, 0.0, 3.0, -3.0, 0.0, 0.0], dtype=torch.float64).deg2rad()
    assert Clusters()(energy, values, PROBLEM).tolist() == [1]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "z"}, "Clusters: symmetry must be one of none, y, y2"),
        ({"within_deg": -1.0}, "Clusters: within_deg must lie between 0 and 180"),
        ({"temperature": 0.0}, "Clusters: temperature must lie between"),
    ],
)
def test_refuses_settings_that_group_nothing(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Clusters(**settings)
