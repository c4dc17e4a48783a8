"""Gauss–Newton by differences."""

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Observation
from kfit.energies import L1, L2
from kfit.generators import Template
from kfit.initializers import Constant
from kfit.optimizers import GaussNewton

LENGTHS = {"roll": 0.002, "shift": 0.005, "scale": 0.005}


def picture():
    grid = torch.linspace(-2, 2, 24, dtype=torch.float64)
    return torch.stack([torch.outer((k * grid).sin(), (grid + k).cos()) for k in (1, 2, 3)]) / 2 + 0.5


def pipeline(lengths=None, energy=None, **settings):
    return FitPipeline(
        Template(picture(), "similarity"),
        {"l2": energy or L2()},
        [Constant({"roll": 0.0, "shift": 0.0, "scale": 1.0})],
        GaussNewton(LENGTHS if lengths is None else lengths, **settings),
        num_starts=1,
        num_steps=6,
    )


def observed():
    truth = {
        "roll": torch.tensor([0.08, -0.05]).double(),
        "shift": torch.tensor([[0.06, -0.04], [0.0, 0.05]]).double(),
        "scale": torch.tensor([1.04, 0.97]).double(),
    }
    return Observation(Template(picture(), "similarity")(**truth).image), truth


def test_a_few_steps_find_a_near_answer():
    observation, truth = observed()
    found = pipeline()(observation, seed=0)
    for name, value in truth.items():
        torch.testing.assert_close(found.values[name], value, rtol=0, atol=2e-3)


def test_a_step_draws_one_picture_for_each_number_and_one_more():
    # Six steps of 1 + 4 pictures and the last look, for two problems.
    assert pipeline()(observed()[0], seed=0).num_evaluations == 2 * (6 * 5 + 1)


def test_no_number_moves_farther_than_its_reach():
    found = pipeline(reach=2.0)(observed()[0], seed=0)
    steps = found.history.values["shift"].diff(dim=0).abs()
    assert float(steps.max()) <= 2.0 * LENGTHS["shift"] + 1e-12
    assert float(steps.max()) > LENGTHS["shift"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"lengths": {"roll": 0.0}}, "lengths of roll"), ({"damping": -1.0}, "damping"), ({"reach": 0.5}, "reach")],
)
def test_a_wrong_setting_is_named(settings, message):
    with pytest.raises(ValueError, match=message):
        GaussNewton(**{"lengths": LENGTHS} | settings)


def test_lengths_must_name_the_variables():
    with pytest.raises(ValueError, match="lengths"):
        pipeline({"roll": 0.01})


def test_terms_must_be_sums_of_squares():
    with pytest.raises(ValueError, match="sums of squares"):
        pipeline(energy=L1())(observed()[0], seed=0)
