"""A prior on rotations read off the picture: how far a rotation is from a head's output, floored, and in a fit."""

import math

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import L2, PosePrior
from kfit.initializers import Constant
from kfit.optimizers import Adam
from tests.fixed_head import FixedHead


def energy(prior, azimuth_deg, elevation_deg=30.0, roll_deg=0.0):
    angles = torch.broadcast_tensors(*(torch.as_tensor(a).float() for a in (azimuth_deg, elevation_deg, roll_deg)))
    values = dict(zip(("azimuth", "elevation", "roll"), (a.reshape(-1).deg2rad() for a in angles), strict=True))
    prepared = prior.prepare(Observation(torch.ones(1, 3, 4, 4)))
    return prior(values, prepared.expand(len(values["roll"]), -1))


def test_it_is_least_at_a_peak_and_rises_from_it_to_the_floor_around_the_circle():
    prior = PosePrior(FixedHead().certain_of((175, 30, 0)), floor=0.01)
    found = energy(prior, [175.0, -175.0, -155.0, 0.0])
    assert (found.diff() > 0).all()
    torch.testing.assert_close(found[3], torch.tensor(-math.log(0.01)), rtol=0, atol=1e-3)


def test_where_all_rotations_are_equally_likely_it_is_flat():
    found = energy(PosePrior(FixedHead()), torch.linspace(-170, 170, 9), 40.0, torch.linspace(0, 300, 9))
    torch.testing.assert_close(found, found[:1].expand(9), rtol=0.1, atol=0)  # for bins are few


@pytest.mark.parametrize("name", ["azimuth_deg", "elevation_deg", "roll_deg"])
def test_near_a_certain_pose_it_is_the_squared_angle_over_four_variances(name):
    pose = {"azimuth_deg": 17.0, "elevation_deg": 0.0, "roll_deg": 50.0}
    prior = PosePrior(FixedHead().certain_of(tuple(pose.values())), floor=1e-6)
    expected = math.radians(6) ** 2 / (4 * math.radians(7) ** 2)
    assert float(energy(prior, **pose | {name: pose[name] + 6})) == pytest.approx(expected, rel=0.05)


def test_straight_from_above_only_the_sum_of_azimuth_and_roll_counts():
    prior = PosePrior(FixedHead().certain_of((60, 90, 0)))
    found = energy(prior, [60.0, 0.0, -30.0, 60.0], 90.0, [0.0, 60.0, 90.0, 60.0])
    torch.testing.assert_close(found[:3], torch.zeros(3), rtol=0, atol=0.01)
    assert found[3] > 3


def test_where_azimuth_is_free_the_vertical_axis_alone_counts():
    prior = PosePrior(FixedHead("y").certain_of((0, 30, 10)))
    found = energy(prior, [0.0, 100.0, 0.0], [30.0, 30.0, 60.0], 10.0)
    torch.testing.assert_close(found[0], found[1])
    assert found[2] > found[0] + 1


def test_a_head_without_roll_leaves_roll_alone():
    found = energy(PosePrior(FixedHead(has_roll=False).certain_of((40, 30, 0))), 40.0, 30.0, [0.0, 90.0])
    torch.testing.assert_close(found[0], found[1])


@pytest.mark.parametrize("floor", [0.0, 0.9])
def test_a_floor_out_of_range_is_an_error(floor):
    with pytest.raises(ValueError, match="PosePrior: floor"):
        PosePrior(FixedHead(), floor)


class Blank(Generator):
    """Draws nothing of its pose: only a prior can move it."""

    def __init__(self):
        super().__init__()
        self.variables = {name: Variable(()) for name in ("azimuth", "elevation", "roll")}

    def forward(self, **values):
        return Rendering(torch.ones(len(values["azimuth"]), 3, 4, 4) + 0 * values["azimuth"].view(-1, 1, 1, 1))


def test_a_pipeline_calls_the_head_once_and_descends_to_its_peak():
    start = {"azimuth": 0.2, "elevation": 0.5, "roll": 0.1}
    pipeline = FitPipeline(
        Blank(),
        {"picture": L2(), "pose": PosePrior(FixedHead().certain_of((24, 20, -10)))},
        [Constant(start)],
        Adam(dict.fromkeys(start, 0.02)),
        num_starts=1,
        num_steps=60,
    )
    result = pipeline(Observation(torch.ones(2, 3, 4, 4)), seed=0)
    assert pipeline.energies["pose"].head.calls == 1
    for name, expected in (("azimuth", 24.0), ("elevation", 20.0), ("roll", -10.0)):
        torch.testing.assert_close(result.values[name].rad2deg(), torch.full((2,), expected), rtol=0, atol=1.5)


def test_a_prior_on_an_unknown_variable_is_an_error():
    prior = PosePrior(FixedHead())
    prior.on = ("azimuth", "tilt")
    with pytest.raises(ValueError, match="tilt"):
        FitPipeline(Blank(), {"pose": prior}, [Constant({"azimuth": 0.2, "elevation": 0.5, "roll": 0.0})], Adam(0.01))
