from __future__ import annotations

import pytest
import torch
from torch import Tensor

from kfit.geometry import (
    CATEGORIES,
    energy_weights,
    rotation_clusters,
    rotation_from_angles,
    rotation_sigma_deg,
)


def rotated(azimuth_deg: list[float], elevation_deg: float = 0.0) -> Tensor:
    azimuth = torch.tensor(azimuth_deg, dtype=torch.float64).deg2rad()
    elevation = torch.full_like(azimuth, elevation_deg).deg2rad()
    return rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth))


def test_a_cluster_gathers_around_its_best_and_takes_what_is_left() -> None:
    rotation = rotated([0, 18, 35, 90, -18, 100])
    energy = torch.tensor([1.0, 2.0, 3.0, 0.5, 4.0, 6.0])
    # Row 3 is best and takes row 5; row 0 takes rows 1 and 4, and 35°, near row 1 but not row 0, stays alone.
    assert rotation_clusters(rotation, energy).tolist() == [1, 1, 2, 0, 1, 0]
    assert rotation_clusters(rotation, energy, within_deg=0).tolist() == [1, 2, 3, 0, 4, 5]


def test_symmetry_makes_one_cluster_of_all_azimuths() -> None:
    rotation, energy = rotated([0, 60, 120, 300], 30.0), torch.arange(4.0)
    assert rotation_clusters(rotation, energy, "y").tolist() == [0, 0, 0, 0]
    assert rotation_clusters(rotation, energy).tolist() == [0, 1, 2, 3]


def test_weights_fall_by_e_for_each_tenth_of_the_best_energy() -> None:
    weight = energy_weights(torch.tensor([2.0, 2.2, 2.4]))
    assert weight.sum().item() == pytest.approx(1)
    assert (weight[:-1] / weight[1:]).log().tolist() == pytest.approx([1, 1], abs=1e-4)


def test_the_spread_is_the_weighted_root_mean_square_of_the_angles() -> None:
    rotation, weight = rotated([0, 10, -20, 170]), torch.tensor([1.0, 2.0, 1.0, 0.0])
    sigma = rotation_sigma_deg(rotation, weight, rotation[0])
    assert sigma.item() == pytest.approx(((2 * 100 + 400) / 4) ** 0.5)
    assert rotation_sigma_deg(rotation, weight, rotation[0], "y").item() == pytest.approx(0, abs=1e-9)


def test_a_category_s_azimuths_follow_from_its_symmetry() -> None:
    assert CATEGORIES["mug"].azimuth_deg == (-180.0, 180.0)
    assert CATEGORIES["can"].azimuth_deg == (0.0, 0.0)
