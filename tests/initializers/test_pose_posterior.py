from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from kfit.core import Observation
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.geometry.pose import rotation_of
from kfit.initializers import PosePosterior
from tests.fixed_head import FixedHead


def starts(head: FixedHead, num_starts: int, **settings: float) -> dict[str, Tensor]:
    observation = Observation(torch.ones(1, 3, 4, 4))
    return PosePosterior(head, **settings)({}, observation, num_starts, [torch.Generator()])


def rotation(azimuth: float, elevation: float, roll: float) -> Tensor:
    return rotation_from_angles(*torch.tensor([azimuth, elevation, roll], dtype=torch.float64).deg2rad())


@pytest.mark.parametrize("symmetry", ["none", "y"])
@pytest.mark.parametrize("pose", [(40, 20, 0), (-170, -60, 100), (13, 89, 77), (0, -90, 180), (3, 5, -179)])
def test_the_first_start_is_within_2_degrees_of_a_certain_head(symmetry, pose) -> None:
    found = rotation_of(starts(FixedHead(symmetry).certain_of(pose), 1))[0]
    assert float(rotation_error(found, rotation(*pose), symmetry).rad2deg()) < 2


def test_peaks_come_first_in_order_of_probability() -> None:
    poses = (40.0, 20.0, 0.0), (-100.0, -30.0, 90.0)
    head = FixedHead().certain_of(*poses, weights=(0.3, 0.7))
    found = rotation_of(starts(head, 2))
    for start, pose in zip(found, reversed(poses), strict=True):
        assert float(rotation_error(start, rotation(*pose)).rad2deg()) < 2


def test_starts_keep_their_distance() -> None:
    found = rotation_of(starts(FixedHead(), 30, apart_deg=40))
    apart = rotation_error(found[:, None], found).rad2deg() + 999 * torch.eye(30)
    assert float(apart.min()) > 40 - 12  # starts lie up to half a bin from their bins' centres


def test_more_starts_than_distant_bins_are_all_different() -> None:
    found = starts(FixedHead(bin_deg=60, sigma_deg=30), 40, apart_deg=120)
    assert len(torch.stack(list(found.values()), 1).unique(dim=0)) == 40


def test_where_azimuth_is_free_azimuths_go_all_around() -> None:
    azimuth = starts(FixedHead("y").certain_of((0, 30, 10)), 100)["azimuth"]
    assert torch.histc(azimuth.float(), 4, -math.pi, math.pi).sub(25).abs().max() < 3


def test_a_head_without_roll_starts_upright() -> None:
    found = starts(FixedHead(has_roll=False).certain_of((40, 20, 0)), 3)
    assert found["roll"].tolist() == [0, 0, 0]
    assert found["azimuth"][0].rad2deg() == pytest.approx(40, abs=2)


def test_the_head_is_frozen_and_a_wrong_distance_is_an_error() -> None:
    head = FixedHead().train()
    assert not PosePosterior(head).head.training
    assert head.training
    with pytest.raises(ValueError, match="PosePosterior: apart_deg must lie between 0 and 180"):
        PosePosterior(head, apart_deg=-1)
