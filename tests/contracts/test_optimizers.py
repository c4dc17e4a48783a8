"""Every shipped optimizer meets every small problem; a new one fails until the table below says how to build it."""

import pytest
import torch
from torch.utils import _pytree as pytree
from walk import shipped

import kfit.optimizers
from kfit.core import Evaluation, GradientEvaluation, Optimizer, Rendering, ResidualEvaluation
from kfit.fitting.jacobian import JacobianProducts
from kfit.optimizers import (
    CMAES,
    LBFGS,
    Adam,
    AutoAdam,
    GaussNewton,
    LearnedSteps,
    LevenbergMarquardt,
    Stages,
    TorchOptimizer,
)

# How to build it, and the number of steps that a small problem takes it.
BUILD = {
    Adam: [(lambda: Adam(0.05, betas=(0.9, 0.999)), 900), (lambda: Adam({"x": 0.05, "y": 0.02}), 900)],
    AutoAdam: [(lambda: AutoAdam(0.04, betas=(0.9, 0.999)), 1200)],
    GaussNewton: [(lambda: GaussNewton({"x": 1e-3, "y": 1e-3}, damping=0.3, reach=500), 80)],
    LBFGS: [(LBFGS, 60), (lambda: LBFGS(history=2, first_step=1.0), 60)],
    LevenbergMarquardt: [(LevenbergMarquardt, 40)],
    TorchOptimizer: [(lambda: TorchOptimizer(torch.optim.Adam, 0.05), 900)],
    CMAES: [(lambda: CMAES(0.5), 200), (lambda: CMAES({"x": 0.5, "y": 0.3}, population=12), 150)],
    Stages: [(lambda: Stages([(Adam(0.1), 12), (LevenbergMarquardt(), 9), (LBFGS(), 9)]), 80)],
}
built = [
    pytest.param(build, steps, id=f"{kind.__name__}-{number}")
    for kind in BUILD
    for number, (build, steps) in enumerate(BUILD[kind])
]
# Those that need no slope where the least energy is.
FOR_KINKS = (Adam, AutoAdam, CMAES, TorchOptimizer)


def quadratic(x, y):
    """Least 0 at x = (1, −2), y = 0.5, ten times as steep along one axis as along another; as residuals."""
    return torch.stack([x[:, 0] - 1, 10**0.5 * (x[:, 1] + 2), 3**0.5 * (y - 0.5)], 1)


def valley(x, y):
    """Rosenbrock's curved valley, least 0 at x = (1, 1), and y = 0; as residuals."""
    return torch.stack([1 - x[:, 0], 10**0.5 * (x[:, 1] - x[:, 0].square()), y], 1)


def spot(x, y):
    """A blurred spot to be moved to (0.3, −0.2) and brightened to exp(0.2): a registration; as residuals."""
    return (spot_at(x, y) - spot_at(x.new_tensor([[0.3, -0.2]]), y.new_tensor([0.2]))).flatten(1)


def spot_at(x, y):
    grid = torch.linspace(-3, 3, 9, dtype=x.dtype)
    across, along = (torch.exp(-((grid - x[:, k, None]) / 2).square()) for k in (0, 1))
    return y.exp()[:, None, None] * along[:, :, None] * across[:, None]


def kink(x, y):
    """Σ|x − 0.3| + |y|, least 0 at x = (0.3, 0.3), y = 0, where it has no slope; roots, for they are squared."""
    return torch.cat([(x - 0.3).abs(), y.abs()[:, None]], 1).sqrt()


PROBLEMS = {
    quadratic: ([1.0, -2.0], 0.5),
    valley: ([1.0, 1.0], 0.0),
    spot: ([0.3, -0.2], 0.2),
    kink: ([0.3, 0.3], 0.0),
}


BREAKING = ("energy", "gradient", "residuals", "infinite")


def evaluation_of(residuals_of, calls=None):
    def evaluate(raw, problem, need="value"):
        assert need in ("value", "gradient", "residuals")
        assert len(problem) == len(raw["x"])
        if calls is not None:
            calls.append((need, len(problem)))
        leaves = {name: tensor.detach().requires_grad_() for name, tensor in raw.items()}
        residuals = residuals_of(**leaves)
        found = residuals.square().sum(1)
        kind, more = Evaluation, {}
        if need == "gradient":
            slopes = torch.autograd.grad(found.sum(), list(leaves.values()))
            kind, more = GradientEvaluation, {"gradient": dict(zip(leaves, slopes, strict=True))}
        elif need == "residuals":
            kind, more = ResidualEvaluation, {"residuals": residuals.detach()}
        picture = torch.cat([raw["x"], raw["y"][:, None]], 1)[:, None, None]
        found = found.detach()
        return kind(found, found, {"only": found}, dict(raw), Rendering(picture), **more)

    def linearize(raw, problem):
        steps = {name: torch.zeros_like(tensor, requires_grad=True) for name, tensor in raw.items()}
        with torch.enable_grad():
            return JacobianProducts([(list(steps.values()), residuals_of(**retract(raw, steps)))])

    return offering(evaluate, linearize)


def retract(raw, step):
    return {name: raw[name] + step[name] for name in raw}


def offering(evaluate, linearize=None):
    """A function as the contract `kfit.core.Evaluate`, all of whose variables are real numbers."""
    evaluate.retract, evaluate.linearize = retract, linearize
    return evaluate


def energy_of(residuals_of, raw):
    return residuals_of(**raw).square().sum(1)


def starts(rows=5):
    rng = torch.Generator().manual_seed(1)
    return {
        "x": torch.randn(rows, 2, generator=rng, dtype=torch.float64),
        "y": torch.randn(rows, generator=rng, dtype=torch.float64),
    }


def seeds(rows=5):
    return torch.arange(100, 100 + rows)


def walk(optimizer, energy, raw, num_steps, memory=None, recorded=None, seed=None):
    memory = optimizer.init(raw, seeds(len(raw["y"])) if seed is None else seed) if memory is None else memory
    problem = torch.zeros(len(raw["y"]), dtype=torch.long)
    for _ in range(num_steps):
        raw, evaluation, memory = optimizer.step(evaluation_of(energy), raw, problem, memory)
        if recorded is not None:
            recorded.append(evaluation.energy)
    return raw, memory


def test_every_shipped_optimizer_is_covered_here_and_exported():
    found = shipped(kfit.optimizers, Optimizer)
    assert found == set(BUILD) | {LearnedSteps}  # which needs pictures, see tests/optimizers/test_learned_steps.py
    assert {kind.__name__ for kind in found} <= set(kfit.optimizers.__all__)


@pytest.mark.parametrize(("build", "steps"), built)
class TestAnOptimizer:
    @pytest.mark.parametrize(
        "energy",
        [valley, spot, pytest.param(quadratic, marks=pytest.mark.slow), pytest.param(kink, marks=pytest.mark.slow)],
        ids=lambda energy: energy.__name__,
    )
    def test_meets_the_small_problems_from_every_start(self, build, steps, energy):
        if energy is kink and not isinstance(build(), FOR_KINKS):
            pytest.skip("needs slopes")
        raw, _ = walk(build(), energy, starts(), steps)
        x, y = PROBLEMS[energy]
        torch.testing.assert_close(raw["x"], torch.tensor(x, dtype=torch.float64).expand(5, 2), rtol=0, atol=0.04)
        torch.testing.assert_close(raw["y"], torch.full((5,), y, dtype=torch.float64), rtol=0, atol=0.04)

    def test_walks_each_row_as_if_it_were_alone(self, build, steps):
        together, _ = walk(build(), valley, starts(), 25)
        for row in range(5):
            start = {name: value[row : row + 1] for name, value in starts().items()}
            alone, _ = walk(build(), valley, start, 25, seed=seeds()[row : row + 1])
            for name, value in alone.items():
                torch.testing.assert_close(together[name][row : row + 1], value, rtol=1e-12, atol=1e-12)

    def test_tells_the_energy_before_the_step(self, build, steps):
        recorded = []
        walk(build(), quadratic, starts(), 1, recorded=recorded)
        torch.testing.assert_close(recorded[0], energy_of(quadratic, starts()))

    def test_has_a_memory_that_leads_with_rows_and_survives_losing_some(self, build, steps):
        optimizer, keep = build(), torch.tensor([4, 1])
        whole, memory = walk(optimizer, valley, starts(), 10)
        assert {len(leaf) for leaf in pytree.tree_leaves(memory) if isinstance(leaf, torch.Tensor)} <= {5}
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
            assert torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b

    def test_a_row_of_nan_stays_alone(self, build, steps):
        raw = starts()
        raw["y"][2] = torch.nan
        broken, _ = walk(build(), quadratic, raw, 10)
        whole, _ = walk(build(), quadratic, starts(), 10)
        others = [0, 1, 3, 4]
        for name, value in whole.items():
            torch.testing.assert_close(broken[name][others], value[others], rtol=0, atol=0)

    @pytest.mark.parametrize(
        "broken",
        ["all", "a trial", *(pytest.param(what, marks=pytest.mark.slow) for what in BREAKING)],
    )
    def test_a_row_that_breaks_on_the_way_stays_alone(self, build, steps, broken):
        found, whole = (ends(build(), how) for how in (broken, None))
        others = [0, 1, 3, 4]
        for name, value in whole.items():
            torch.testing.assert_close(found[name][others], value[others], rtol=0, atol=0)


def ends(optimizer, broken, num_steps=10):
    """Where five rows, each a problem of its own, end when something of the third is no number from step 4 on."""
    raw, problem = starts(), torch.arange(5)
    memory, spoilt, walked, evaluations = (
        optimizer.init(raw, seeds()),
        torch.inf if broken == "infinite" else torch.nan,
        [],
        [],
    )

    def evaluate(raw, problem, need="value"):
        recorded = evaluation_of(valley)(raw, problem, need)
        evaluations.append(need)
        if len(walked) < 4 or broken is None or (broken == "a trial" and len(evaluations) == 1):
            return recorded
        parts = {"energy": [recorded.energy, recorded.ranking], "gradient": getattr(recorded, "gradient", {}).values()}
        parts["residuals"] = [getattr(recorded, "residuals", None)]
        for tensor in parts[broken] if broken in parts else [part for held in parts.values() for part in held]:
            if tensor is not None:
                tensor[problem == 2] = spoilt
        return recorded

    while len(walked) < num_steps:
        evaluations.clear()
        raw, _, memory = optimizer.step(offering(evaluate), raw, problem, memory)
        walked.append(raw)
    return raw


class TestAutoAdam:
    def test_first_changes_the_picture_by_as_much_for_each_variable(self):
        raw, _ = walk(AutoAdam(0.01), quadratic, starts(), 1)
        # the picture holds the three numbers themselves: x moves two of its pixels, y one
        moved = {name: (raw[name] - start).abs() for name, start in starts().items()}
        torch.testing.assert_close(moved["x"], torch.full((5, 2), 0.01 * 1.5**0.5, dtype=torch.float64))
        torch.testing.assert_close(moved["y"], torch.full((5,), 0.01 * 3**0.5, dtype=torch.float64))

    def test_measures_once_with_a_picture_for_each_variable(self):
        calls, raw, optimizer = [], starts(), AutoAdam()
        memory = optimizer.init(raw, seeds())
        for _ in range(3):
            raw, _, memory = optimizer.step(evaluation_of(quadratic, calls), raw, torch.zeros(5).long(), memory)
        assert calls == [("gradient", 5), ("value", 5), ("value", 5), ("gradient", 5), ("gradient", 5)]

    def test_moves_what_changes_nothing_by_one_unit_at_most(self):
        def evaluate(raw, problem, need="value"):
            recorded = evaluation_of(quadratic)(raw, problem, need)
            recorded.rendering = Rendering(0 * recorded.rendering.image)
            return recorded

        optimizer = AutoAdam()
        raw, *_ = optimizer.step(offering(evaluate), starts(), torch.zeros(5).long(), optimizer.init(starts(), seeds()))
        assert (raw["x"] - starts()["x"]).abs().max() <= 1

    @pytest.mark.parametrize("change", [0.0, float("nan")])
    def test_refuses_a_change_that_is_not_above_zero(self, change):
        with pytest.raises(ValueError, match="AutoAdam: change must be above 0"):
            AutoAdam(change)


@pytest.mark.parametrize("build", [LBFGS, LevenbergMarquardt], ids=["LBFGS", "LevenbergMarquardt"])
@pytest.mark.parametrize("energy", [quadratic, valley, spot, kink], ids=lambda energy: energy.__name__)
def test_no_row_s_energy_ever_rises(build, energy):
    recorded = []
    walk(build(), energy, starts(), 20, recorded=recorded)
    assert bool((torch.stack(recorded).diff(dim=0) <= 0).all())


class TestCMAES:
    def test_asks_for_energies_alone(self):
        calls, raw, optimizer = [], starts(), CMAES(population=6)
        optimizer.step(evaluation_of(quadratic, calls), raw, torch.zeros(5).long(), optimizer.init(raw, seeds()))
        assert calls == [("value", 5), ("value", 30)]

    def test_gives_each_row_s_population_the_row_s_problem(self):
        recorded = []

        def evaluate(raw, problem, need="value"):
            recorded.append(problem.tolist())
            return evaluation_of(quadratic)(raw, problem, need)

        optimizer = CMAES(population=4)
        optimizer.step(offering(evaluate), starts(2), torch.tensor([3, 1]), optimizer.init(starts(2), seeds(2)))
        assert recorded == [[3, 1], [3] * 4 + [1] * 4]

    def test_draws_by_the_row_s_seed_alone(self):
        raw, problem = {name: value[:1].expand(3, *value.shape[1:]) for name, value in starts().items()}, torch.zeros(3)
        optimizer = CMAES()
        memory = optimizer.init(raw, torch.tensor([5, 6, 5]))
        torch.manual_seed(1)
        new, *_ = optimizer.step(evaluation_of(valley), raw, problem.long(), memory)
        torch.testing.assert_close(new["x"][0], new["x"][2], rtol=0, atol=0)
        assert not torch.allclose(new["x"][0], new["x"][1])

    @pytest.mark.parametrize("sigma", [0.0, {"x": 0.1, "y": -1.0}])
    def test_refuses_spreads_that_are_not_above_zero(self, sigma):
        with pytest.raises(ValueError, match=r"CMAES: sigma (of y )?must be above 0"):
            CMAES(sigma)

    def test_refuses_a_population_without_a_better_half(self):
        with pytest.raises(ValueError, match="CMAES: population must be at least 4, got 3"):
            CMAES(population=3)

    def test_refuses_spreads_that_do_not_name_the_variables(self):
        with pytest.raises(ValueError, match="sigma: nothing for y; the names are x, y"):
            CMAES({"x": 0.1}).init(starts(), seeds())


class TestStages:
    def test_take_turns_and_the_last_goes_on(self):
        first, second = Adam(0.1), Adam(0.02)
        staged, _ = walk(Stages([(first, 3), (second, 1)]), valley, starts(), 8)
        middle, _ = walk(first, valley, starts(), 3)
        apart, _ = walk(second, valley, middle, 5)
        for name, value in apart.items():
            torch.testing.assert_close(staged[name], value, rtol=0, atol=0)

    def test_check_the_names_of_all_at_the_start(self):
        stages = Stages([(Adam(), 3), (Adam({"zoom": 0.1}), 3)])
        with pytest.raises(ValueError, match="rates: unknown zoom"):
            stages.init(starts(), seeds())

    @pytest.mark.parametrize(
        ("stages", "message"), [([], "at least one item"), ([(Adam(), 0)], "steps of Adam must be at least 1")]
    )
    def test_refuse_to_be_empty(self, stages, message):
        with pytest.raises(ValueError, match=message):
            Stages(stages)
