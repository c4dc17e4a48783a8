"""The pipeline on a generator that is a formula: a Gaussian spot whose truth is known."""

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest
import torch
from torch import nn

from kfit import FitPipeline
from kfit.callbacks import Progress, Pruning
from kfit.core import (
    Angle,
    Bounded,
    Callback,
    Encoder,
    Energy,
    FitError,
    Generator,
    Initializer,
    Observation,
    Positive,
    Prior,
    Rendering,
    Schedule,
    Selector,
    Variable,
)
from kfit.energies import L2, Silhouette
from kfit.initializers import Constant, EncoderPosterior, Uniform
from kfit.optimizers import Adam

SIDE = 16
TRUTH = {
    "x": [0.3, -0.4, 0.1],
    "y": [-0.2, 0.35, 0.1],
    "radius": [0.3, 0.22, 0.4],
    "angle": [0.5, -0.9, 1.2],
}


class Spot(Generator):
    """A dark spot at (x, y), twice as long as wide, its long side turned by an angle."""

    def __init__(self):
        super().__init__()
        self.variables = {
            "x": Variable((), Bounded(-1.0, 1.0)),
            "y": Variable(),
            "radius": Variable((), Positive()),
            "angle": Variable((), Angle()),
        }
        self.ink = nn.Parameter(torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64))
        self.blur = nn.Dropout(0.5)  # draws otherwise unless in evaluation mode

    def forward(self, **values):
        at = {name: value[:, None, None] for name, value in values.items()}
        v, u = torch.meshgrid(*[torch.linspace(-1, 1, SIDE, dtype=torch.float64)] * 2, indexing="ij")
        u, v = u - at["x"], v - at["y"]
        along = at["angle"].cos() * u + at["angle"].sin() * v
        across = at["angle"].cos() * v - at["angle"].sin() * u
        mask = torch.exp(-((along / (2 * at["radius"])).square() + (across / at["radius"]).square()))[:, None]
        return Rendering(1 - self.blur(mask * self.ink[:, None, None]), mask)


def spots(rows=(0, 1, 2), **changes):
    values = {name: torch.tensor(truth, dtype=torch.float64)[list(rows)] for name, truth in (TRUTH | changes).items()}
    with torch.no_grad():
        drawn = Spot().eval()(**values)
    return Observation(drawn.image, drawn.mask, keys=tuple(100 + row for row in rows))


def starts_anywhere():
    return [Uniform("x", -0.6, 0.6), Uniform("y", -0.6, 0.6), Constant({"radius": 0.5}), Uniform("angle", -1.5, 1.5)]


class Given(Initializer):
    """Starts that the test writes down; variables not named start at 0.3."""

    on = ("x", "y", "radius", "angle")

    def __init__(self, **values):
        self.values = values

    def __call__(self, variables, observation, num_starts, rngs):
        rows = observation.num_problems * num_starts
        filled = {name: torch.full((rows,), 0.3, dtype=torch.float64) for name in self.on}
        return filled | {name: torch.tensor(value, dtype=torch.float64) for name, value in self.values.items()}


def pipeline(**changes):
    settings = {
        "generator": Spot(),
        "energies": {"image": L2()},
        "initializers": starts_anywhere(),
        "optimizer": Adam({"x": 0.1, "y": 0.03, "radius": 0.05, "angle": 0.03}),
        "num_starts": 4,
        "num_steps": 12,
    }
    return FitPipeline(**settings | changes)


def counting(fit):
    """Number of rows of each drawing."""
    drawn = []
    fit.generator.register_forward_hook(lambda module, args, rendering: drawn.append(len(rendering.image)))
    return drawn


def path(result, row, start):
    """What one start did: energies, and values by name."""
    history = result.history
    return history.energy[:, row, start], {name: value[:, row, start] for name, value in history.values.items()}


def assert_same_path(found, expected, tolerance=1e-9):
    torch.testing.assert_close(found[0], expected[0], rtol=tolerance, atol=tolerance)
    for name, value in expected[1].items():
        torch.testing.assert_close(found[1][name], value, rtol=tolerance, atol=tolerance)


class TestTheAnswer:
    def test_is_the_known_truth(self):
        result = pipeline(num_starts=6, num_steps=150)(spots(), seed=0)
        for name in ("x", "y", "radius"):
            torch.testing.assert_close(
                result.values[name], torch.tensor(TRUTH[name], dtype=torch.float64), rtol=0, atol=5e-3
            )
        apart = (result.values["angle"] - torch.tensor(TRUTH["angle"])).sub(math.pi / 2) % math.pi - math.pi / 2
        assert apart.abs().max() < 1e-2
        assert result.energy.max() < 1e-5
        assert not result.dropped

    def test_holds_winner_alternatives_and_history_in_their_shapes(self):
        result = pipeline()(spots(), seed=0)
        assert result.energy.shape == result.start.shape == (3,)
        assert {name: value.shape for name, value in result.values.items()} == dict.fromkeys(TRUTH, (3,))
        assert result.all_problem.tolist() == [0] * 4 + [1] * 4 + [2] * 4
        assert result.all_start.tolist() == [0, 1, 2, 3] * 3
        assert result.all_energy.shape == result.all_values["x"].shape == (12,)
        history = result.history
        assert history.energy.shape == history.terms["image"].shape == history.values["angle"].shape == (13, 3, 4)
        assert not history.energy.isnan().any()

    def test_is_the_best_of_the_starts_and_never_worse_than_any_iterate(self):
        result = pipeline()(spots(), seed=0)
        torch.testing.assert_close(result.all_energy.view(3, 4), result.history.energy.amin(0))
        torch.testing.assert_close(result.energy, result.all_energy.view(3, 4).amin(1))
        assert result.start.tolist() == result.all_energy.view(3, 4).argmin(1).tolist()

    def test_reaches_its_energy_with_its_values(self):
        result = pipeline()(spots(), seed=0)
        drawn = Spot().eval()(**result.values).image.detach()
        torch.testing.assert_close(L2()(drawn, spots().image), result.energy)

    def test_is_the_best_start_itself_without_steps(self):
        fit = pipeline(num_steps=0, num_starts=2, initializers=[Given(x=[0.3, 0.0, 0.5, -0.4])])
        result = fit(spots(rows=(0, 1)), seed=0)
        assert result.values["x"].tolist() == pytest.approx([0.3, -0.4])
        assert result.start.tolist() == [0, 1]
        assert result.history.energy.shape == (1, 2, 2)

    def test_asks_for_no_gradients(self):
        result = pipeline(num_steps=2)(spots(), seed=0)
        tensors = [result.energy, *result.values.values(), *result.all_values.values(), result.history.energy]
        assert not any(tensor.requires_grad for tensor in tensors)

    def test_is_that_of_the_selector(self):
        class Worst(Selector):
            def __call__(self, energy, values, problem):
                assert energy.shape == problem.shape == values["x"].shape
                return torch.stack([energy.where(problem == p, -torch.inf).argmax() for p in problem.unique()])

        result = pipeline(selector=Worst())(spots(), seed=0)
        torch.testing.assert_close(result.energy, result.all_energy.view(3, 4).amax(1))

    def test_comes_in_the_type_of_the_observation(self):
        single = spots().map(torch.Tensor.float)
        result = pipeline(generator=Spot().float(), num_steps=1)(single, seed=0)
        assert {value.dtype for value in result.values.values()} == {torch.float32}


class TestRowsAreAlone:
    """Paths are equal in float64 to 1e-9: batches of other sizes may add up in another order."""

    def test_a_problem_walks_the_path_that_it_walks_alone(self):
        fit = pipeline()
        together = fit(spots(), seed=3)
        for row in range(3):
            alone = fit(spots(rows=(row,)), seed=3)
            for start in range(4):
                assert_same_path(path(together, row, start), path(alone, 0, start))
            torch.testing.assert_close(together.energy[row], alone.energy[0], rtol=1e-9, atol=1e-9)
            assert together.start[row] == alone.start[0]

    def test_a_survivor_walks_the_path_that_it_walks_without_pruning(self):
        whole = pipeline()(spots(), seed=3)
        pruned = pipeline(callbacks=[Pruning({3: 2, 7: 1})])(spots(), seed=3)
        assert pruned.all_problem.tolist() == [0, 1, 2]
        for row, start in enumerate(pruned.all_start.tolist()):
            assert_same_path(path(pruned, row, start), path(whole, row, start))

    def test_each_initializer_has_a_stream_of_its_own(self):
        first = pipeline(num_steps=0)(spots(), seed=3).history.values
        other = pipeline(
            num_steps=0, initializers=[Constant({"x": 0.0, "radius": 0.5}), *starts_anywhere()[1::2]]
        )(spots(), seed=3).history.values  # fmt: skip
        for name in ("y", "angle"):
            torch.testing.assert_close(first[name], other[name])

    def test_the_seed_decides_and_torch_s_own_numbers_stay_as_they_were(self):
        fit = pipeline(num_steps=2)
        before = torch.get_rng_state()
        first, again, other = (fit(spots(), seed=seed) for seed in (5, 5, 6))
        assert torch.equal(torch.get_rng_state(), before)
        torch.testing.assert_close(first.history.energy, again.history.energy, rtol=0, atol=0)
        assert not torch.allclose(first.history.energy, other.history.energy)

    def test_without_a_seed_torch_s_own_numbers_decide(self):
        fit = pipeline(num_steps=0)
        torch.manual_seed(0)
        first, second = fit(spots()), fit(spots())
        torch.manual_seed(0)
        again = fit(spots())
        torch.testing.assert_close(first.energy, again.energy, rtol=0, atol=0)
        assert not torch.allclose(first.history.energy, second.history.energy)

    def test_problems_with_the_same_key_get_the_same_starts_and_those_of_others_differ(self):
        pictures = spots().image
        values = pipeline(num_steps=0)(Observation(pictures, keys=(7, 7, 8)), seed=0).history.values["x"][0]
        torch.testing.assert_close(values[0], values[1])
        assert not torch.allclose(values[0], values[2])
        unnamed = pipeline(num_steps=0)(Observation(pictures), seed=0).history.values["x"][0]
        torch.testing.assert_close(unnamed[0], unnamed[2])


class TestTheWork:
    @pytest.mark.parametrize(("num_starts", "num_steps"), [(1, 0), (4, 3), (2, 12)])
    def test_targets_are_prepared_once_a_fit_whatever_its_length(self, num_starts, num_steps, monkeypatch):
        fit, calls = pipeline(num_starts=num_starts, num_steps=num_steps), []
        energy = fit.energies["image"]
        real = energy.prepare
        monkeypatch.setattr(energy, "prepare", lambda *given: calls.append(len(given[0])) or real(*given))
        fit(spots(), seed=0)
        assert calls == [3]

    def test_targets_are_gathered_anew_only_when_the_survivors_change(self, monkeypatch):
        fit, seen = pipeline(callbacks=[Pruning({3: 2, 5: 2, 7: 1})]), []
        energy = fit.energies["image"]
        real = energy.compare

        def spy(prediction, prepared):
            seen.append(prepared["target"])  # held, so that no other tensor can take its place in memory
            return real(prediction, prepared)

        monkeypatch.setattr(energy, "compare", spy)
        fit(spots(), seed=0)
        gathered = [seen[0], *(b for a, b in pairwise(seen) if a is not b)]
        assert [len(target) for target in gathered] == [12, 6, 3]
        assert len(seen) == 13

    def test_every_start_is_drawn_once_a_step_and_once_at_the_end(self):
        fit = pipeline()
        drawn = counting(fit)
        result = fit(spots(), seed=0)
        assert drawn == [12] * 13
        assert result.num_evaluations == sum(drawn) == 3 * 4 * 13

    def test_what_is_pruned_is_drawn_no_more(self):
        fit = pipeline(callbacks=[Pruning({3: 2, 7: 1})])
        drawn = counting(fit)
        result = fit(spots(), seed=0)
        assert drawn == [12] * 4 + [6] * 4 + [3] * 5
        assert result.num_evaluations == sum(drawn)

    def test_candidates_are_drawn_once_and_the_best_are_started(self):
        fit = pipeline(num_starts=2, num_candidates=5, num_steps=1)
        drawn = counting(fit)
        result = fit(spots(), seed=3)
        assert drawn == [15, 6, 6]
        assert result.num_evaluations == 27
        proposed = pipeline(num_starts=5, num_steps=0)(spots(), seed=3).history
        for problem, energy in enumerate(proposed.energy[0]):
            best = energy.argsort()[:2].sort().values
            torch.testing.assert_close(result.history.energy[0, problem], energy[best])
            torch.testing.assert_close(result.history.values["x"][0, problem], proposed.values["x"][0, problem, best])

    def test_fewer_candidates_than_starts_are_refused(self):
        with pytest.raises(ValueError, match="num_candidates must be at least num_starts, 4, got 3"):
            pipeline(num_starts=4, num_candidates=3)

    def test_callbacks_are_called_at_the_start_at_each_step_and_at_the_end(self):
        class Log(Callback):
            def __init__(self):
                self.said = []

            def on_start(self, state):
                self.said.append(("start", state.step, len(state.problem), set(state.raw)))

            def on_step(self, state):
                self.said.append(state.step)
                return state

            def on_end(self, result):
                self.said.append(result)

        log = Log()
        result = pipeline(num_steps=2, callbacks=[log])(spots(), seed=0)
        assert log.said == [("start", 0, 12, set(TRUTH)), 0, 1, 2, result]


class TestPruning:
    def test_keeps_the_best_of_each_problem_and_their_numbers(self):
        whole = pipeline(num_steps=4)(spots(), seed=1)
        pruned = pipeline(num_steps=4, callbacks=[Pruning({4: 2})])(spots(), seed=1)
        best = whole.all_energy.view(3, 4).argsort(1)[:, :2].sort(1).values
        assert pruned.all_problem.tolist() == [0, 0, 1, 1, 2, 2]
        assert pruned.all_start.view(3, 2).tolist() == best.tolist()
        assert pruned.start.tolist() == whole.start.tolist()

    def test_leaves_nan_in_the_history_of_those_that_left(self):
        history = pipeline(callbacks=[Pruning({3: 1})])(spots(), seed=1).history
        assert not history.energy[:4].isnan().any()
        for held in (history.energy, history.terms["image"], history.values["x"]):
            assert (~held[4:].isnan()).sum(2).tolist() == [[1, 1, 1]] * 9

    def test_keeps_all_where_there_are_fewer(self):
        assert len(pipeline(callbacks=[Pruning({0: 9})])(spots(), seed=1).all_energy) == 12

    @pytest.mark.parametrize("keep", [{3: 0}, {-1: 4}])
    def test_refuses_to_keep_nothing_or_to_act_before_the_start(self, keep):
        with pytest.raises(
            ValueError, match=r"Pruning: (keep of 3 must be at least 1|step of keep must be at least 0)"
        ):
            Pruning(keep)


class Cliff(Prior):
    """Nothing below a height, no number above it."""

    def __init__(self, height, on="y"):
        super().__init__()
        self.height, self.on = height, on

    def forward(self, value):
        return torch.where(value > self.height, torch.nan, 0 * value)


class Spike(Prior):
    """Finite everywhere, without a slope at one point."""

    on = "y"

    def forward(self, value):
        return (value - 0.25).abs().sqrt()


class TestBrokenRows:
    fine = (0.1, 0.1, 0.0, -0.1, 0.2, 0.15)
    one_broken = (0.1, 0.9, 0.0, -0.1, 0.2, 0.15)

    def fit(self, y, **changes):
        energies = {"image": L2(), "cliff": Cliff(0.8)}
        return pipeline(initializers=[Given(y=y)], num_starts=3, energies=energies, **changes)

    def test_are_dropped_reported_and_reach_no_other(self):
        broken, whole = (self.fit(y)(spots(rows=(0, 1)), seed=0) for y in (self.one_broken, self.fine))
        assert broken.dropped == [(0, 1, 0)]
        assert broken.all_start.tolist() == [0, 2, 0, 1, 2]
        assert broken.history.energy[:, 0, 1].isnan().all()
        for row, start in ((0, 0), (0, 2), (1, 0), (1, 1), (1, 2)):
            assert_same_path(path(broken, row, start), path(whole, row, start), 1e-12)
        assert broken.energy.isfinite().all()

    def test_may_break_on_the_way(self):
        # The truth of problem 1 lies at y = 0.35, beyond a cliff at 0.3.
        fit = pipeline(
            initializers=[Given(y=[0.1, -9.0])],
            num_starts=2,
            energies={"image": L2(), "cliff": Cliff(0.3)},
            num_steps=40,
        )
        result = fit(spots(rows=(1,)), seed=0)
        ((problem, start, step),) = result.dropped
        assert (problem, start) == (0, 0)
        assert 0 < step < 40
        energy = result.history.energy[:, 0]
        assert energy[:step, 0].isfinite().all()
        assert energy[step:, 0].isnan().all()
        assert energy[:, 1].isfinite().all()
        assert result.start.tolist() == [1]

    def test_break_when_only_their_slope_is_no_number(self):
        fit = pipeline(
            initializers=[Given(y=[0.25, 0.5])], num_starts=2, energies={"image": L2(), "spike": Spike()}, num_steps=3
        )
        result = fit(spots(rows=(0,)), seed=0)
        assert result.dropped == [(0, 0, 0)]
        assert result.start.tolist() == [1]

    def test_leave_a_problem_without_an_answer_while_others_have_theirs(self):
        starts = (0.9, 0.9, 1.0, *self.fine[3:]), self.fine
        broken, whole = (self.fit(y)(spots(rows=(0, 1)), seed=0) for y in starts)
        assert broken.start.tolist() == [-1, int(whole.start[1])]
        assert broken.energy.isnan().tolist() == [True, False]
        assert [value.isnan().tolist() for value in broken.values.values()] == [[True, False]] * 4
        torch.testing.assert_close(broken.energy[1], whole.energy[1])
        assert broken.all_problem.tolist() == [1, 1, 1]

    def test_of_every_problem_raise_an_error_in_a_sentence(self):
        said = r"^every start of every problem became NaN or infinite by step 0 of the fit$"
        with pytest.raises(FitError, match=said):
            self.fit([0.9] * 6)(spots(rows=(0, 1)), seed=0)

    def test_leave_counts_and_pruning_in_order(self):
        fit = self.fit(self.one_broken, callbacks=[Pruning({2: 2}), Pruning({5: 1})])
        drawn = counting(fit)
        result = fit(spots(rows=(0, 1)), seed=0)
        assert drawn == [6, 5, 5, 4, 4, 4] + [2] * 7
        assert result.all_problem.tolist() == [0, 1]


class Fade(Schedule):
    def __init__(self, first, last):
        self.first, self.last = first, last

    def __call__(self, step, num_steps):
        return self.first + (self.last - self.first) * step / num_steps


class Wish(Prior):
    """The value itself."""

    def __init__(self, on):
        super().__init__()
        self.on = on

    def forward(self, value):
        return value


BOTH = {"image": L2(), "mask": Silhouette()}


class TestWeights:
    def test_stand_outside_the_energies(self):
        history = pipeline(energies=BOTH, weights={"mask": 0.25})(spots(), seed=0).history
        torch.testing.assert_close(history.energy, history.terms["image"] + 0.25 * history.terms["mask"])

    def test_may_be_schedules_and_the_best_is_judged_by_the_last(self):
        result = pipeline(energies=BOTH, weights={"image": Fade(0.0, 2.0), "mask": Fade(1.0, 0.5)})(spots(), seed=0)
        terms, step = result.history.terms, torch.arange(13.0, dtype=torch.float64)[:, None, None] / 12
        energy = 2 * step * terms["image"] + (1 - 0.5 * step) * terms["mask"]
        torch.testing.assert_close(result.history.energy, energy)
        ranked = 2 * terms["image"] + 0.5 * terms["mask"]
        torch.testing.assert_close(result.all_energy.view(3, 4), ranked.amin(0))

    def test_of_zero_at_a_step_leave_the_term_out_there(self):
        result = pipeline(energies=BOTH, weights={"mask": Fade(1.0, 0.0)})(spots(), seed=0)
        mask = result.history.terms["mask"]
        assert mask.shape == (13, 3, 4)
        assert mask.isnan().flatten(1).all(1).tolist() == [False] * 12 + [True]
        assert not result.history.terms["image"].isnan().any()

    def test_of_zero_throughout_cost_nothing(self, monkeypatch):
        fit = pipeline(energies=BOTH, weights={"mask": 0.0})
        monkeypatch.setattr(fit.energies["mask"], "compare", lambda *given: pytest.fail("compared in vain"))
        assert set(fit(spots(), seed=0).history.terms) == {"image"}

    def test_for_ranking_change_the_winner_and_not_the_paths(self):
        settings = {"energies": {"image": L2(), "left": Wish("x")}, "weights": {"left": 0.0}}
        by_picture = pipeline(**settings)(spots(), seed=0)
        by_wish = pipeline(**settings, rank_weights={"left": 1.0})(spots(), seed=0)
        torch.testing.assert_close(by_wish.history.energy, by_picture.history.energy)
        assert by_wish.start.tolist() != by_picture.start.tolist()
        leftmost = by_wish.history.values["x"].amin(0)
        torch.testing.assert_close(by_wish.energy, leftmost.amin(1))
        torch.testing.assert_close(by_wish.values["x"], leftmost.amin(1))

    def test_are_one_unless_given(self):
        one = pipeline(energies=BOTH, weights={"image": 1.0, "mask": 1.0})(spots(), seed=0)
        torch.testing.assert_close(pipeline(energies=BOTH)(spots(), seed=0).energy, one.energy)


class TestMistakes:
    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"weights": {"picture": 1.0}}, r"weights: unknown picture; the names are image$"),
            ({"rank_weights": {"mask": 1.0}}, r"rank_weights: unknown mask; the names are image$"),
            ({"rank_weights": {"image": 0.0}}, r"rank_weights must hold a number other than 0"),
            ({"weights": {"image": 0.0}}, r"rank_weights must hold a number other than 0"),
            ({"optimizer": Adam({"x": 0.1, "zoom": 0.1})}, r"rates: unknown zoom; the names are angle, radius, x, y$"),
            ({"optimizer": Adam({"x": 0.1, "y": 0.1})}, r"rates: nothing for angle, radius; the names are"),
            ({"initializers": starts_anywhere()[:2]}, r"initializers: nothing for angle, radius; the names are"),
            (
                {"initializers": [*starts_anywhere(), Constant({"y": 0.0, "x": 0.0})]},
                r"initializers: x, y set by two initializers",
            ),
            (
                {"initializers": [*starts_anywhere(), Constant({"zoom": 0.0})]},
                r"initializers: unknown zoom; the names are angle, radius, x, y$",
            ),
            ({"energies": {}}, r"energies must name at least one energy"),
            ({"energies": {"far": Wish("zoom")}}, r"energies.far.on: unknown zoom; the names are angle, radius, x, y$"),
            ({"num_starts": 0}, r"num_starts must be at least 1"),
            ({"num_steps": -1}, r"num_steps must be at least 0"),
        ],
    )
    def test_are_told_when_the_pipeline_is_built(self, changes, said):
        with pytest.raises(ValueError, match=said):
            pipeline(**changes)

    def test_a_field_that_was_not_seen_is_an_error_that_lists_those_that_were(self):
        fit = pipeline(energies={"image": L2(), "mask": Silhouette()})
        with pytest.raises(ValueError, match=r"observation has no 'mask'; it has image"):
            fit(Observation(spots().image), seed=0)

    def test_a_field_that_is_not_drawn_is_an_error_that_lists_those_that_are(self):
        class Far(L2):
            on = "depth"

        with pytest.raises(ValueError, match=r"rendering has no 'depth'; it has image, mask"):
            pipeline(energies={"far": Far()})(Observation(spots().image, depth=spots().mask), seed=0)

    def test_starts_of_a_wrong_shape_are_an_error_that_names_the_initializer(self):
        fit = pipeline(initializers=[Given(x=[0.0, 0.1])])
        with pytest.raises(ValueError, match=r"Given must give 'x' in shape \(12,\), got \(2,\)"):
            fit(spots(), seed=0)

    def test_an_observation_without_pictures_is_an_error(self):
        with pytest.raises(ValueError, match="observation must hold at least one picture"):
            pipeline()(Observation(torch.zeros(0, 3, SIDE, SIDE, dtype=torch.float64)), seed=0)


class TestSurroundings:
    def test_the_original_generator_is_left_as_it_was(self):
        generator = Spot().train()
        fit = pipeline(generator=generator)
        fit(spots(), seed=0)
        assert generator.training
        assert generator.blur.training
        assert generator.ink.requires_grad
        assert generator.ink.grad is None
        assert fit.generator.ink.data_ptr() == generator.ink.data_ptr()

    def test_a_pipeline_stays_in_evaluation_mode_inside_a_module_in_training(self):
        fit = pipeline()
        expected = fit(spots(), seed=0)
        whole = nn.ModuleList([fit]).train()
        assert whole.training
        assert not any(module.training for module in fit.modules())
        torch.testing.assert_close(fit(spots(), seed=0).energy, expected.energy, rtol=0, atol=0)

    def test_a_later_training_of_the_generator_is_seen(self):
        generator = Spot()
        fit = pipeline(generator=generator)
        before = fit(spots(), seed=0)
        with torch.no_grad():
            generator.ink.mul_(0.5)
        assert not torch.allclose(fit(spots(), seed=0).energy, before.energy)

    @pytest.mark.parametrize("inside", [torch.inference_mode, torch.no_grad, torch.enable_grad])
    def test_a_fit_gives_the_same_answer_inside_any_gradient_mode(self, inside):
        fit = pipeline(energies={"image": L2(), "mask": Silhouette()})
        expected = fit(spots(), seed=0)
        with inside():
            for seen in (spots(), Observation(spots().image, spots().mask + 0, keys=spots().keys)):
                torch.testing.assert_close(fit(seen, seed=0).energy, expected.energy, rtol=0, atol=0)
        assert torch.is_grad_enabled()

    def test_a_picture_from_outside_and_a_mask_from_inside_inference_mode_go_together(self):
        fit, seen = pipeline(energies={"image": L2(), "mask": Silhouette()}), spots()
        expected = fit(seen, seed=0)
        with torch.inference_mode():
            mixed = Observation(seen.image, seen.mask.clone(), keys=seen.keys)
        assert mixed.mask.is_inference()
        assert not mixed.image.is_inference()
        torch.testing.assert_close(fit(mixed, seed=0).energy, expected.energy, rtol=0, atol=0)

    def test_a_pipeline_built_in_inference_mode_fits_outside_it(self):
        generator = Spot()
        with torch.inference_mode():
            fit = pipeline(generator=generator)
        torch.testing.assert_close(fit(spots(), seed=0).energy, pipeline()(spots(), seed=0).energy)

    def test_four_threads_at_once_get_the_answers_that_they_get_alone(self):
        fit = pipeline(callbacks=[Pruning({4: 2})])
        seen = [spots(rows=rows) for rows in ((0,), (1, 2), (2, 0, 1), (1,))]
        alone = [fit(observation, seed=number) for number, observation in enumerate(seen)]
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(lambda number: fit(seen[number], seed=number), range(4)))
        for one, other in zip(together, alone, strict=True):
            torch.testing.assert_close(one.history.energy, other.history.energy, rtol=0, atol=0, equal_nan=True)
            assert one.start.tolist() == other.start.tolist()
            assert one.num_evaluations == other.num_evaluations

    def test_bound_generators_fit_what_is_left(self):
        fixed = {name: torch.tensor(TRUTH[name][0], dtype=torch.float64) for name in ("radius", "angle")}
        fit = pipeline(
            generator=Spot().bind(**fixed), initializers=starts_anywhere()[:2], optimizer=Adam(0.05), num_steps=80
        )
        result = fit(spots(rows=(0,)), seed=0)
        assert set(result.values) == {"x", "y"}
        assert float(result.values["x"]) == pytest.approx(0.3, abs=5e-3)

    def test_moving_a_pipeline_moves_the_networks_of_its_initializers(self):
        class Guess(Encoder):
            def __init__(self):
                super().__init__()
                self.layer = nn.Linear(3 * SIDE**2, 2)

            def forward(self, image):
                mean, log_variance = self.layer(image.flatten(1)).chunk(2, 1)
                return mean, log_variance

        class Scaled(Spot):
            def __init__(self):
                super().__init__()
                self.variables = {"code": Variable((1,))}

            def forward(self, code):
                fixed = {name: torch.full_like(code[:, 0], TRUTH[name][0]) for name in ("y", "radius", "angle")}
                return super().forward(x=code[:, 0], **fixed)

        guess = Guess().train()
        fit = pipeline(generator=Scaled(), initializers=[EncoderPosterior(guess)], optimizer=Adam(0.02), num_steps=2)
        assert fit.double()(spots(rows=(0,)), seed=0).values["code"].dtype == torch.float64
        assert guess.layer.weight.dtype == torch.float32
        assert guess.training


def test_a_weight_map_hides_what_is_in_front_of_the_object():
    seen = spots(rows=(0,))
    hidden = torch.zeros_like(seen.mask)
    hidden[..., 9:, 10:] = 1
    image = torch.where(hidden > 0, torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)[:, None, None], seen.image)
    settings = {"num_starts": 6, "num_steps": 150}
    masked = pipeline(**settings)(Observation(image, weight=1 - hidden, keys=seen.keys), seed=0)
    assert masked.energy.max() < 1e-5
    for name in ("x", "y", "radius"):
        assert float(masked.values[name]) == pytest.approx(TRUTH[name][0], abs=1e-2)
    misled = pipeline(**settings)(Observation(image, keys=seen.keys), seed=0)
    assert abs(float(misled.values["x"]) - TRUTH["x"][0]) > 0.05


def test_twenty_steps_walk_the_path_of_torch_s_adam_with_a_parameter_group_for_each_variable():
    rates = {"x": 0.1, "y": 0.03, "radius": 0.05, "angle": 0.02}
    begin = {"x": [-0.2, 0.4], "y": [0.1, 0.2], "radius": [0.5, 0.35], "angle": [0.2, -0.6]}
    result = pipeline(
        initializers=[Given(**begin)], optimizer=Adam(rates, betas=(0.5, 0.999)), num_starts=2, num_steps=20
    )(spots(rows=(0,)), seed=0)

    generator, target = Spot().eval(), spots(rows=(0,)).image
    spaces = {name: variable.space for name, variable in generator.variables.items()}
    raw = {n: spaces[n].to_raw(torch.tensor(v, dtype=torch.float64)).requires_grad_() for n, v in begin.items()}
    adam = torch.optim.Adam([{"params": [raw[name]], "lr": rate} for name, rate in rates.items()], betas=(0.5, 0.999))
    for step in range(21):
        values = {name: spaces[name].to_value(raw[name]) for name in raw}
        energy = (generator(**values).image - target).square().mean((1, 2, 3))
        torch.testing.assert_close(result.history.energy[step, 0], energy.detach(), rtol=1e-9, atol=1e-12)
        for name, value in values.items():
            torch.testing.assert_close(result.history.values[name][step, 0], value.detach(), rtol=1e-9, atol=1e-10)
        adam.zero_grad()
        energy.sum().backward()
        adam.step()


def test_an_energy_may_compare_several_fields_at_once():
    class Both(Energy):
        on = ("image", "mask")

        def prepare(self, target, weight=None):
            assert set(target) == {"image", "mask"}
            return dict(target)

        def compare(self, prediction, prepared):
            return sum((prediction[name] - prepared[name]).square().mean((1, 2, 3)) for name in self.on)

    both = pipeline(energies={"both": Both()})(spots(), seed=0)
    apart = pipeline(energies={"image": L2(), "mask": Silhouette()})(spots(), seed=0)
    torch.testing.assert_close(both.energy, apart.energy)


class TestProgress:
    def test_is_silent_where_stderr_is_no_terminal(self, capsys):
        pipeline(num_steps=2, callbacks=[Progress()])(spots(), seed=0)
        assert capsys.readouterr() == ("", "")

    def test_tells_of_the_fit_on_a_terminal_also_after_one_that_broke_off(self, capsys, monkeypatch):
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        settings = {"num_starts": 1, "num_steps": 2, "energies": {"image": L2(), "cliff": Cliff(0.5)}}
        progress = [Progress()]
        with pytest.raises(FitError):
            pipeline(**settings, initializers=[Given(y=[0.9])], callbacks=progress)(spots(rows=(0,)), seed=0)
        pipeline(**settings, initializers=[Given(y=[0.0])], callbacks=progress)(spots(rows=(0,)), seed=0)
        pipeline(**settings, initializers=[Given(y=[0.0])], callbacks=[Progress()])(spots(rows=(0,)), seed=0)
        out, err = capsys.readouterr()
        assert not out
        assert "1 starts · energy" in err


class TestHistoryOfAFit:
    def test_holds_values_at_every_so_many_steps_or_none(self):
        whole = pipeline()(spots(), seed=0).history
        some = pipeline(history=5)(spots(), seed=0).history
        none = pipeline(history=False)(spots(), seed=0).history
        torch.testing.assert_close(some.values["x"], whole.values["x"][::5], rtol=0, atol=0)
        assert none.values == {}
        assert (whole.value_stride, some.value_stride, none.value_stride) == (1, 5, 0)
        for fewer in (some, none):
            torch.testing.assert_close(fewer.energy, whole.energy, rtol=0, atol=0)

    @pytest.mark.parametrize("stride", [0, -1])
    def test_refuses_a_stride_below_one(self, stride):
        with pytest.raises(ValueError, match="history must be at least 1"):
            pipeline(history=stride)
