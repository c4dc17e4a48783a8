from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from kfit.core import Angle, Observation, Variable
from kfit.geometry import PoseNetwork
from kfit.initializers import PosePosterior

VARIABLES = {"azimuth": Variable((), Angle()), "elevation": Variable((), Angle())}


class Says(PoseNetwork):
    """Tells every picture the same shares (A, E)."""

    def __init__(self, share: Tensor) -> None:
        super().__init__()
        turns, rings = share.shape
        self.share = share / share.sum()
        self.azimuths = math.pi * (2 * (torch.arange(turns) + 0.5) / turns - 1)
        self.elevations = torch.deg2rad(10.0 * torch.arange(rings))

    def forward(self, image: Tensor) -> Tensor:
        return self.share.clamp(min=1e-20).log().expand(len(image), -1, -1)


def starts(initializer: PosePosterior, num_starts: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    rngs = [torch.Generator().manual_seed(seed)]
    given = initializer(VARIABLES, Observation(torch.ones(1, 3, 4, 4)), num_starts, rngs)
    return given["azimuth"].rad2deg(), given["elevation"].rad2deg()


def two_peaks() -> Tensor:
    """36 bins of 10° from −175° on: 0.6 at (45°, 20°), 0.3 at (−175°, 40°), little elsewhere."""
    share = torch.full((36, 6), 1e-4)
    share[22, 2], share[0, 4] = 0.6, 0.3
    return share


def test_the_peaks_come_first_in_order() -> None:
    azimuth, elevation = starts(PosePosterior(Says(two_peaks())), 8)
    assert azimuth[:2].tolist() == pytest.approx([45, -175], abs=0.1)
    assert elevation[:2].tolist() == pytest.approx([20, 40], abs=0.1)


def test_starts_keep_their_distance_also_across_the_seam_of_the_circle() -> None:
    azimuth, elevation = starts(PosePosterior(Says(two_peaks()), apart_deg=25), 12)
    turned = (azimuth[:, None] - azimuth + 180) % 360 - 180
    apart = torch.hypot(turned, elevation[:, None] - elevation) + 999 * torch.eye(12)
    assert apart.min() > 25 - 10  # starts lie up to half a bin from their bins' centres


def test_a_start_lies_between_bins_where_the_shares_do() -> None:
    share = torch.zeros(36, 6)
    share[22, 2], share[23, 2], share[22, 3] = 0.5, 0.25, 0.25
    azimuth, elevation = starts(PosePosterior(Says(share)), 1)
    assert azimuth.tolist() == pytest.approx([45 + 0.25 * 10])
    assert elevation.tolist() == pytest.approx([20 + 0.25 * 10])


def test_a_start_beside_the_seam_is_drawn_over_it() -> None:
    share = torch.zeros(36, 6)
    share[0, 2], share[35, 2] = 0.6, 0.4
    azimuth, _ = starts(PosePosterior(Says(share)), 1)
    assert azimuth.tolist() == pytest.approx([-175 - 4])


def test_more_starts_than_distant_bins_fall_between_and_are_all_different() -> None:
    azimuth, elevation = starts(PosePosterior(Says(two_peaks()), apart_deg=60), 60)
    assert len(torch.stack([azimuth, elevation], 1).unique(dim=0)) == 60


def test_samples_follow_the_distribution_and_fill_their_bins() -> None:
    azimuth, elevation = starts(PosePosterior(Says(two_peaks()), sample=True), 4000)
    first = (azimuth - 45).abs().le(5) & (elevation - 20).abs().le(5)
    # The rest of the bins hold 214 · 1e-4 beside the peaks' 0.9.
    assert first.double().mean() == pytest.approx(0.6 / 0.9214, abs=0.03)
    assert azimuth[first].std().item() == pytest.approx(10 / 12**0.5, abs=0.15)
    again, _ = starts(PosePosterior(Says(two_peaks()), sample=True), 4000)
    other, _ = starts(PosePosterior(Says(two_peaks()), sample=True), 4000, seed=1)
    assert torch.equal(azimuth, again)
    assert not torch.equal(azimuth, other)


@pytest.mark.parametrize("sample", [False, True])
def test_where_azimuth_is_free_elevations_follow_the_head_and_azimuths_go_all_around(sample: bool) -> None:
    share = torch.tensor([[0.0, 0.5, 0.5, 0.0, 0.0]])
    azimuth, elevation = starts(PosePosterior(Says(share), sample=sample), 400)
    assert 5 - 1e-3 <= elevation.min() < 6
    assert 24 < elevation.max() <= 25 + 1e-3
    assert elevation.mean().item() == pytest.approx(15, abs=0.1 if not sample else 1)
    assert torch.histc(azimuth.float(), 4, -180, 180).sub(100).abs().max() < (3 if not sample else 30)


def test_the_head_is_frozen_and_a_wrong_distance_refused() -> None:
    head = Says(two_peaks()).train()
    assert not PosePosterior(head).head.training
    assert head.training
    with pytest.raises(ValueError, match="PosePosterior: apart_deg must lie between 0 and 180"):
        PosePosterior(head, apart_deg=-1)
