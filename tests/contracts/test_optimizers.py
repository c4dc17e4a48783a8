"""Every shipped optimizer meets every small problem; a new one fails until the table below says how to build it."""

import pytest
import torch
from torch.utils import _pytree as pytree
from walk import shipped

import kfit.optimizers
from kfit.core import Evaluation, Optimizer
from kfit.optimizers import Adam

# How to build it, and the number of steps that a small problem takes it.
BUILD = {Adam: [(lambda: Adam(0.05, betas=(0.9, 0.999)), 1500), (lambda: Adam({"x": 0.05, "y": 0.02}), 1500)]}
built = [
    pytest.param(build, steps, id=f"{kind.__name__}-{number}")
    for kind in BUILD
    for number, (build, steps) in enumerate(BUILD[kind])
]


def quadratic(x, y):
    """Least 0 at x = (1, −2), y = 0.5, ten times as steep along one axis as along another."""
    return (x - x.new_tensor([1.0, -2.0])).square() @ x.new_tensor([1.0, 10.0]) + 3 * (y - 0.5).square()


def valley(x, y):
    """Rosenbrock's curved valley, least 0 at x = (1, 1), and y = 0."""
    return (1 - x[:, 0]).square() + 10 * (x[:, 1] - x[:, 0].square()).square() + y.square()


def kink(x, y):
    """Least 0 at x = (0.3, 0.3), y = 0, where it has no slope."""
    return (x - 0.3).abs().sum(1) + y.abs()


PROBLEMS = {quadratic: ([1.0, -2.0], 0.5), valley: ([1.0, 1.0], 0.0), kink: ([0.3, 0.3], 0.0)}


def evaluation_of(energy, calls=None):
    def evaluate(raw, problem, need="value"):
        assert need in ("value", "gradient")
        assert len(problem) == len(raw["x"])
        if calls is not None:
            calls.append((need, len(problem)))
        leaves = {name: tensor.detach().requires_grad_() for name, tensor in raw.items()}
        found = energy(**leaves)
        gradient = None
        if need == "gradient":
            gradient = dict(zip(leaves, torch.autograd.grad(found.sum(), list(leaves.values())), strict=True))
        found = found.detach()
        return Evaluation(found, found, {"only": found}, dict(raw), gradient)

    return evaluate


def starts(rows=5):
    rng = torch.Generator().manual_seed(1)
    return {
        "x": torch.randn(rows, 2, generator=rng, dtype=torch.float64),
        "y": torch.randn(rows, generator=rng, dtype=torch.float64),
    }


def walk(optimizer, energy, raw, num_steps, memory=None, seen=None):
    memory = optimizer.init(raw) if memory is None else memory
    problem = torch.zeros(len(raw["y"]), dtype=torch.long)
    for _ in range(num_steps):
        raw, evaluation, memory = optimizer.step(evaluation_of(energy), raw, problem, memory)
        if seen is not None:
            seen.append(evaluation.energy)
    return raw, memory


def test_every_shipped_optimizer_is_covered_here_and_exported():
    found = shipped(kfit.optimizers, Optimizer)
    assert found == set(BUILD)
    assert {kind.__name__ for kind in found} <= set(kfit.optimizers.__all__)


@pytest.mark.parametrize(("build", "steps"), built)
class TestAnOptimizer:
    @pytest.mark.parametrize("energy", PROBLEMS, ids=lambda energy: energy.__name__)
    def test_meets_the_small_problems_from_every_start(self, build, steps, energy):
        raw, _ = walk(build(), energy, starts(), steps)
        x, y = PROBLEMS[energy]
        torch.testing.assert_close(raw["x"], torch.tensor(x, dtype=torch.float64).expand(5, 2), rtol=0, atol=0.04)
        torch.testing.assert_close(raw["y"], torch.full((5,), y, dtype=torch.float64), rtol=0, atol=0.04)

    def test_walks_each_row_as_if_it_were_alone(self, build, steps):
        together, _ = walk(build(), valley, starts(), 25)
        for row in range(5):
            alone, _ = walk(build(), valley, {name: value[row : row + 1] for name, value in starts().items()}, 25)
            for name, value in alone.items():
                torch.testing.assert_close(together[name][row : row + 1], value, rtol=1e-12, atol=1e-12)

    def test_tells_the_energy_before_the_step(self, build, steps):
        seen = []
        walk(build(), quadratic, starts(), 1, seen=seen)
        torch.testing.assert_close(seen[0], quadratic(**starts()))

    def test_has_a_memory_that_leads_with_rows_and_survives_losing_some(self, build, steps):
        optimizer, keep = build(), torch.tensor([4, 1])
        whole, memory = walk(optimizer, valley, starts(), 10)
        assert {len(leaf) for leaf in pytree.tree_leaves(memory) if isinstance(leaf, torch.Tensor)} == {5}
        fewer = {name: value[keep] for name, value in whole.items()}
        kept = pytree.tree_map_only(torch.Tensor, lambda tensor: tensor[keep], memory)
        expected, _ = walk(optimizer, valley, whole, 15, memory)
        found, _ = walk(optimizer, valley, fewer, 15, kept)
        for name, value in found.items():
            torch.testing.assert_close(value, expected[name][keep], rtol=1e-12, atol=1e-12)

    def test_changes_nothing_in_place(self, build, steps):
        optimizer = build()
        raw, memory = walk(optimizer, valley, starts(), 3)
        before = pytree.tree_map_only(torch.Tensor, torch.clone, (raw, memory))
        walk(optimizer, valley, raw, 2, memory)
        after, found = pytree.tree_leaves(before), pytree.tree_leaves((raw, memory))
        for a, b in zip(after, found, strict=True):
            torch.testing.assert_close(a, b, rtol=0, atol=0)

    def test_a_row_of_nan_stays_alone(self, build, steps):
        raw = starts()
        raw["y"][2] = torch.nan
        broken, _ = walk(build(), quadratic, raw, 10)
        whole, _ = walk(build(), quadratic, starts(), 10)
        others = [0, 1, 3, 4]
        for name, value in whole.items():
            torch.testing.assert_close(broken[name][others], value[others], rtol=0, atol=0)


class TestAdam:
    def test_asks_for_one_evaluation_a_step(self):
        calls, raw, optimizer = [], starts(), Adam(0.1)
        memory = optimizer.init(raw)
        for _ in range(3):
            raw, _, memory = optimizer.step(evaluation_of(quadratic, calls), raw, torch.zeros(5).long(), memory)
        assert calls == [("gradient", 5)] * 3

    def test_walks_the_path_of_torch_s_own(self):
        leaves = {name: value.clone().requires_grad_() for name, value in starts().items()}
        theirs = torch.optim.Adam(
            [{"params": [leaves["x"]], "lr": 0.07}, {"params": [leaves["y"]], "lr": 0.02}], betas=(0.5, 0.999)
        )
        for _ in range(20):
            theirs.zero_grad()
            valley(**leaves).sum().backward()
            theirs.step()
        ours, _ = walk(Adam({"x": 0.07, "y": 0.02}), valley, starts(), 20)
        for name, value in ours.items():
            torch.testing.assert_close(value, leaves[name].detach(), rtol=1e-11, atol=1e-11)

    def test_stays_close_to_torch_s_own_in_single_precision(self):
        leaf = starts()["x"].float().requires_grad_()
        theirs = torch.optim.Adam([leaf], lr=0.05, betas=(0.5, 0.999))
        y = starts()["y"].float()
        for _ in range(20):
            theirs.zero_grad()
            quadratic(leaf, y).sum().backward()
            theirs.step()
        ours, _ = walk(Adam(0.05), lambda x, y: quadratic(x, 0 * y), {"x": starts()["x"].float(), "y": y}, 20)
        torch.testing.assert_close(ours["x"], leaf.detach(), rtol=1e-4, atol=1e-4)

    def test_first_moves_each_number_by_its_rate(self):
        raw, _ = walk(Adam({"x": 0.05, "y": 0.02}), quadratic, starts(), 1)
        torch.testing.assert_close((raw["x"] - starts()["x"]).abs(), torch.full((5, 2), 0.05, dtype=torch.float64))
        torch.testing.assert_close((raw["y"] - starts()["y"]).abs(), torch.full((5,), 0.02, dtype=torch.float64))

    @pytest.mark.parametrize("rates", [0.0, -1.0, float("nan"), {"x": 0.1, "y": 0.0}])
    def test_refuses_rates_that_are_not_above_zero(self, rates):
        with pytest.raises(ValueError, match=r"Adam: rates must be above 0, got .* for (rates|y)"):
            Adam(rates)

    @pytest.mark.parametrize("betas", [(1.0, 0.9), (0.9, -0.1)])
    def test_refuses_betas_outside_their_range(self, betas):
        with pytest.raises(ValueError, match="Adam: betas"):
            Adam(betas=betas)

    @pytest.mark.parametrize(
        ("rates", "said"), [({"x": 0.1, "z": 0.1, "y": 0.1}, "unknown z"), ({"x": 0.1}, "nothing for y")]
    )
    def test_refuses_rates_that_do_not_name_the_variables(self, rates, said):
        with pytest.raises(ValueError, match=f"rates: {said}; the names are x, y"):
            Adam(rates).init(starts())
