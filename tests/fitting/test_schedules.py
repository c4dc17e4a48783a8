import jsonargparse
import pytest
import torch

from kfit.core import Schedule
from kfit.fitting.schedules import Cosine, Linear, Step


def over(schedule, num_steps=10):
    return [schedule(step, num_steps) for step in range(num_steps + 1)]


def test_linear_goes_evenly_from_start_to_end():
    assert over(Linear(2, 0)) == pytest.approx([2 - 0.2 * step for step in range(11)])


def test_cosine_walks_as_torch_s_annealing():
    weight = torch.nn.Parameter(torch.zeros(()))
    optimizer = torch.optim.SGD([weight], lr=2.0)
    theirs = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, T_max=10, eta_min=0.5)
    expected = []
    for _ in range(11):
        expected.append(theirs.get_last_lr()[0])
        optimizer.step()
        theirs.step()
    assert over(Cosine(2.0, 0.5)) == pytest.approx(expected)


def test_step_jumps_at_its_shares_of_the_steps():
    assert over(Step([1, 0.5, 0], at=[0.3, 0.7])) == [1] * 3 + [0.5] * 4 + [0] * 4
    assert over(Step([1, 0], at=[1.0]), 4) == [1, 1, 1, 1, 0]
    assert over(Step([3], at=[])) == [3] * 11


@pytest.mark.parametrize("schedule", [Linear(2, 0.5), Cosine(2, 0.5), Step([2, 0.5], at=[0.5])])
def test_each_ends_at_its_end_also_in_a_fit_of_no_steps(schedule):
    assert schedule(0, 50) == 2
    assert schedule(50, 50) == schedule(0, 0) == 0.5


def test_steps_that_do_not_go_together_are_refused():
    with pytest.raises(ValueError, match="at, one number fewer than weights, must hold 1 items"):
        Step([1, 2], at=[0.1, 0.2])
    with pytest.raises(ValueError, match=r"at, .*must lie between 0 and 1, got 20"):
        Step([1, 2], at=[20])
    with pytest.raises(ValueError, match="at must rise"):
        Step([1, 2, 3], at=[0.5, 0.2])


def test_a_recipe_builds_weights_that_are_numbers_and_schedules():
    parser = jsonargparse.ArgumentParser()
    parser.add_argument("--weights", type=dict[str, float | Schedule])
    recipe = """
    weights:
      image: 0.5
      mask: {class_path: kfit.fitting.schedules.Linear, init_args: {start: 1, end: 0}}
      edges: {class_path: kfit.fitting.schedules.Step, init_args: {weights: [1, 0.1], at: [0.4]}}
    """
    weights = parser.instantiate(parser.parse_string(recipe)).weights
    assert weights["image"] == 0.5
    assert weights["mask"](5, 10) == 0.5
    assert weights["edges"](4, 10) == 0.1
