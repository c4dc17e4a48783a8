"""Pruning beside every optimizer, on pictures to be registered."""

import pytest
import torch

from kfit import FitPipeline
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.energies import L2
from kfit.generators import Template
from kfit.initializers import Constant, Uniform
from kfit.optimizers import CMAES, LBFGS, Adam, AutoAdam, LevenbergMarquardt, Stages

OPTIMIZERS = [
    Adam(0.02),
    AutoAdam(),
    LBFGS(),
    LevenbergMarquardt(),
    CMAES(0.05),
    Stages([(Adam(0.02), 3), (LevenbergMarquardt(), 2), (CMAES(0.01), 2)]),
]


def picture():
    grid = torch.linspace(-2, 2, 12, dtype=torch.float64)
    return torch.stack([torch.outer((k * grid).sin(), (grid + k).cos()) for k in (1, 2, 3)]) / 2 + 0.5


def observed():
    truth = {
        "roll": torch.tensor([0.2, -0.3]).double(),
        "shift": torch.tensor([[0.1, -0.1], [0.0, 0.2]]).double(),
        "scale": torch.tensor([1.1, 0.9]).double(),
    }
    return Observation(Template(picture(), "similarity")(**truth).image, keys=(4, 9))


def fit(optimizer, observation=None, callbacks=(), seed=2):
    pipeline = FitPipeline(
        Template(picture(), "similarity"),
        {"l2": L2()},
        [Uniform("roll", -0.3, 0.3), Uniform("shift", -0.2, 0.2), Constant({"scale": 1.0})],
        optimizer,
        callbacks=callbacks,
        num_starts=5,
        num_steps=8,
    )
    return pipeline(observed() if observation is None else observation, seed=seed)


def assert_same_path(found, expected, row, start, problem=None):
    problem = row if problem is None else problem
    pairs = [(found.history.energy, expected.history.energy)]
    pairs += [(found.history.values[name], value) for name, value in expected.history.values.items()]
    for one, other in pairs:
        torch.testing.assert_close(one[:, row, start], other[:, problem, start], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("optimizer", OPTIMIZERS, ids=lambda optimizer: type(optimizer).__name__)
class TestWithAnOptimizer:
    def test_a_survivor_walks_the_path_that_it_walks_without_pruning(self, optimizer):
        whole = fit(optimizer)
        pruned = fit(optimizer, callbacks=[Pruning({2: 3, 5: 1})])
        assert pruned.all_problem.tolist() == [0, 1]
        assert pruned.num_evaluations < whole.num_evaluations
        for row, start in enumerate(pruned.all_start.tolist()):
            assert_same_path(pruned, whole, row, start)

    def test_a_problem_walks_the_path_that_it_walks_alone(self, optimizer):
        together, both = fit(optimizer), observed()
        alone = fit(optimizer, Observation(both.image[1:], keys=both.keys[1:]))
        for start in range(5):
            assert_same_path(alone, together, 0, start, problem=1)

    def test_the_seed_decides_the_path_and_not_the_numbers_of_torch(self, optimizer):
        first = fit(optimizer)
        torch.manual_seed(7)
        again, other = fit(optimizer), fit(optimizer, seed=3)
        torch.testing.assert_close(first.history.energy, again.history.energy, rtol=0, atol=0)
        assert not torch.allclose(first.history.energy, other.history.energy)
