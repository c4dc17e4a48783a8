"""Problems that end early, beside others that go on."""

import pytest
import torch

from kfit.callbacks import Pruning, Stopping
from kfit.core import Callback, Observation
from kfit.optimizers import Adam
from tests.callbacks.test_pruning import fit, observed


class Rests(Callback):
    """Has one problem rest from a step on."""

    def __init__(self, problem, step):
        self.problem, self.step = problem, step

    def on_step(self, state):
        return state.freeze((state.problem == self.problem) & (state.step >= self.step))


class Rows(Callback):
    """How many rows of each problem each step sees."""

    def __init__(self):
        self.counts = []

    def on_step(self, state):
        self.counts.append(state.problem.bincount(minlength=2).tolist())
        return state


def test_a_problem_at_rest_costs_nothing_and_the_other_walks_as_alone():
    whole, rested = fit(Adam(0.02)), fit(Adam(0.02), callbacks=[Rests(0, 3)])
    # Five starts of two problems at nine looks, less those of one problem after the fourth.
    assert (whole.num_evaluations, rested.num_evaluations) == (90, 65)
    torch.testing.assert_close(rested.energy[1], whole.energy[1], rtol=1e-8, atol=0)
    assert rested.history.energy[4:, 0].isnan().all()


def test_a_problem_at_rest_keeps_its_starts_and_its_best():
    rested = fit(Adam(0.02), callbacks=[Rests(0, 3)])
    assert rested.all_problem.tolist() == [0] * 5 + [1] * 5
    assert rested.all_start.tolist() == [*range(5), *range(5)]
    torch.testing.assert_close(rested.energy[0], rested.history.energy[:4, 0].min())


def test_the_fit_ends_when_all_are_at_rest():
    rested = fit(Adam(0.02), callbacks=[Rests(0, 2), Rests(1, 4)])
    assert len(rested.history.energy) == 5
    assert rested.energy.isfinite().all()


def test_pruned_starts_do_not_come_back():
    rested = fit(Adam(0.02), callbacks=[Pruning({1: 2}), Rests(0, 3)])
    assert rested.all_problem.tolist() == [0, 0, 1, 1]


def test_stopping_ends_a_problem_that_no_longer_falls():
    rows = Rows()
    # Steps of nothing: the energy never falls after the first look.
    found = fit(Adam({"roll": 0.0, "shift": 0.0, "scale": 0.0}), callbacks=[Stopping(patience=2), rows])
    assert rows.counts == [[5, 5], [5, 5], [0, 0]]
    assert found.num_evaluations == 30


def test_stopping_lets_a_problem_that_falls_go_on():
    rows = Rows()
    fit(Adam(0.005), callbacks=[Stopping(tolerance=1e-6, patience=3), rows])
    assert rows.counts[-1] == [5, 5]


def test_a_problem_stops_in_company_as_it_does_alone():
    both, stopping = observed(), [Stopping(0.05, 2)]
    together = fit(Adam(0.02), both, stopping)
    for row in (0, 1):
        alone = fit(Adam(0.02), Observation(both.image[row : row + 1], keys=both.keys[row : row + 1]), stopping)
        steps = len(alone.history.energy)
        torch.testing.assert_close(together.history.energy[:steps, row], alone.history.energy[:, 0])
        assert together.history.energy[steps:, row].isnan().all()


@pytest.mark.parametrize(("name", "value"), [("tolerance", -0.1), ("tolerance", 1.0), ("patience", 0)])
def test_a_wrong_setting_is_named(name, value):
    with pytest.raises(ValueError, match=f"Stopping: {name}"):
        Stopping(**{name: value})
