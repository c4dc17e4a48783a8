"""A prior on poses read off the picture: how far a pose is from what a head says, floored, in a fit of its own."""

import math

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import L2, PosePrior
from kfit.geometry import PoseNetwork, bin_log_probabilities
from kfit.initializers import Constant
from kfit.optimizers import Adam


class Says(PoseNetwork):
    """Says the same of every picture; how often it was asked is counted."""

    def __init__(self, share):
        super().__init__()
        rows, rings = share.shape
        self.register_buffer("azimuths", (torch.arange(rows) + 0.5) / rows * 2 * math.pi - math.pi)
        self.register_buffer("elevations", math.radians(10) * torch.arange(rings))
        self.register_buffer("share", share / share.sum())
        self.asked = 0

    def forward(self, image):
        self.asked += 1
        return self.share.log().expand(len(image), -1, -1)


def peak(row=20, ring=4):
    share = torch.full((36, 9), 1e-9)
    share[row, ring] = 1
    return Says(share)


def energy(prior, azimuth, elevation):
    picture = Observation(torch.ones(1, 3, 4, 4))
    given = {"azimuth": torch.as_tensor(azimuth).view(-1), "elevation": torch.as_tensor(elevation).view(-1)}
    return prior(given, prior.prepare(picture).expand(given["azimuth"].numel(), -1, -1))


def test_it_is_least_at_a_peak_and_rises_from_it_to_the_floor_the_short_way_around():
    head = peak(row=35)
    prior = PosePrior(head, floor=0.01)
    turns = head.azimuths[35] + torch.deg2rad(torch.tensor([0.0, 10.0, 20.0, 180.0]))
    found = energy(prior, turns, head.elevations[4].expand(4))
    assert (found.diff() > 0).all()
    torch.testing.assert_close(found[3], torch.tensor(-math.log(0.01)), rtol=0, atol=1e-4)


def test_where_all_poses_are_alike_it_is_flat():
    prior = PosePrior(Says(torch.ones(36, 9)))
    found = energy(prior, torch.linspace(-3, 3, 7), torch.full((7,), 0.7))
    torch.testing.assert_close(found, found[:1].expand(7), rtol=0, atol=5e-3)  # for bins are few


@pytest.mark.parametrize("degrees", [-4.0, 1.0, 43.0, 79.0, 84.0])
def test_a_head_that_is_sure_of_a_pose_is_believed_up_to_the_edges_of_its_range(degrees):
    head, true = Says(torch.ones(36, 9)), torch.tensor([0.3, math.radians(degrees)])
    log_azimuth, log_elevation = bin_log_probabilities(*true[:, None], head.azimuths, head.elevations, head.sigma)
    prior = PosePrior(Says((log_azimuth[0, :, None] + log_elevation[0]).exp()))
    tried = true[1] + torch.deg2rad(torch.linspace(-20, 20, 81))
    found = energy(prior, true[:1].expand(81), tried)
    assert found.argmin() == 40
    assert found[40] == pytest.approx(0, abs=1e-5)


def test_near_a_sure_pose_it_is_the_angle_squared_by_four_times_the_spread_squared():
    head = Says(torch.ones(36, 9))
    at = torch.tensor([0.3]), torch.tensor([0.7])
    log_azimuth, log_elevation = bin_log_probabilities(*at, head.azimuths, head.elevations, head.sigma)
    prior = PosePrior(Says((log_azimuth[0, :, None] + log_elevation[0]).exp()), floor=1e-6)
    away = math.radians(5)
    expected = away**2 / (4 * head.sigma**2)
    assert energy(prior, at[0] + away, at[1]).item() == pytest.approx(expected, rel=0.02)
    assert energy(prior, at[0], at[1] + away).item() == pytest.approx(expected, rel=0.02)


def test_where_azimuth_is_free_elevation_alone_counts():
    share = torch.full((1, 9), 1e-9)
    share[0, 3] = 1
    found = energy(
        PosePrior(Says(share)), torch.tensor([0.0, 2.0, 0.0]), torch.deg2rad(torch.tensor([30.0, 30.0, 60.0]))
    )
    torch.testing.assert_close(found[0], found[1])
    assert found[2] > found[0] + 1


@pytest.mark.parametrize("floor", [0.0, 0.9])
def test_a_floor_out_of_range_is_an_error(floor):
    with pytest.raises(ValueError, match="PosePrior: floor"):
        PosePrior(peak(), floor)


class Blank(Generator):
    """Draws nothing of its pose: only a prior can move it."""

    def __init__(self):
        super().__init__()
        self.variables = {"azimuth": Variable(()), "elevation": Variable(())}

    def forward(self, **values):
        return Rendering(torch.ones(len(values["azimuth"]), 3, 4, 4) + 0 * values["azimuth"].view(-1, 1, 1, 1))


def test_a_pipeline_asks_the_head_once_and_descends_to_its_peak():
    head = peak()
    pipeline = FitPipeline(
        Blank(),
        {"picture": L2(), "pose": PosePrior(head)},
        [Constant({"azimuth": 0.2, "elevation": 0.5})],
        Adam({"azimuth": 0.02, "elevation": 0.02}),
        num_starts=1,
        num_steps=60,
    )
    result = pipeline(Observation(torch.ones(2, 3, 4, 4)), seed=0)
    assert pipeline.energies["pose"].head.asked == 1
    for name, expected in (("azimuth", head.azimuths[20]), ("elevation", head.elevations[4])):
        torch.testing.assert_close(result.values[name], expected.expand(2), rtol=0, atol=0.02)


def test_a_prior_on_an_unknown_variable_is_an_error():
    prior = PosePrior(peak())
    prior.on = ("azimuth", "tilt")
    with pytest.raises(ValueError, match="tilt"):
        FitPipeline(Blank(), {"pose": prior}, [Constant({"azimuth": 0.2, "elevation": 0.5})], Adam(0.01))
