"""The pipeline on a generator that is a formula: a Gaussian spot whose truth is known."""

import math
import sys
from itertools import pairwise

import pytest
import torch
from spot_fits import TRUTH, Cliff, FixedStart, Spot, assert_same_path, counting, path, pipeline, spots, starts_anywhere

from kfit.callbacks import Progress, Pruning
from kfit.core import Callback, Energy, FitError, Observation, Selector
from kfit.energies import L2, Silhouette
from kfit.initializers import Constant
from kfit.optimizers import Adam


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
        fit = pipeline(num_steps=0, num_starts=2, initializers=[FixedStart(x=[0.3, 0.0, 0.5, -0.4])])
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
        monkeypatch.setattr(energy, "prepare", lambda *args: calls.append(len(args[0])) or real(*args))
        fit(spots(), seed=0)
        assert calls == [3]

    def test_targets_are_gathered_anew_only_when_the_survivors_change(self, monkeypatch):
        fit, recorded = pipeline(callbacks=[Pruning({3: 2, 5: 2, 7: 1})]), []
        energy = fit.energies["image"]
        real = energy.compare

        def spy(prediction, prepared):
            recorded.append(prepared["target"])  # held, so that no other tensor can take its place in memory
            return real(prediction, prepared)

        monkeypatch.setattr(energy, "compare", spy)
        fit(spots(), seed=0)
        gathered = [recorded[0], *(b for a, b in pairwise(recorded) if a is not b)]
        assert [len(target) for target in gathered] == [12, 6, 3]
        assert len(recorded) == 13

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
                self.calls = []

            def on_start(self, state):
                self.calls.append(("start", state.step, len(state.problem), set(state.raw)))

            def on_step(self, state):
                self.calls.append(state.step)
                return state

            def on_end(self, result):
                self.calls.append(result)

        log = Log()
        result = pipeline(num_steps=2, callbacks=[log])(spots(), seed=0)
        assert log.calls == [("start", 0, 12, set(TRUTH)), 0, 1, 2, result]


def test_a_weight_map_hides_what_is_in_front_of_the_object():
    observed = spots(rows=(0,))
    hidden = torch.zeros_like(observed.mask)
    hidden[..., 9:, 10:] = 1
    image = torch.where(hidden > 0, torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)[:, None, None], observed.image)
    settings = {"num_starts": 6, "num_steps": 150}
    masked = pipeline(**settings)(Observation(image, weight=1 - hidden, keys=observed.keys), seed=0)
    assert masked.energy.max() < 1e-5
    for name in ("x", "y", "radius"):
        assert float(masked.values[name]) == pytest.approx(TRUTH[name][0], abs=1e-2)
    misled = pipeline(**settings)(Observation(image, keys=observed.keys), seed=0)
    assert abs(float(misled.values["x"]) - TRUTH["x"][0]) > 0.05


def test_twenty_steps_walk_the_path_of_torch_s_adam_with_parameter_groups():
    rates = {"x": 0.1, "y": 0.03, "radius": 0.05, "angle": 0.02}
    begin = {"x": [-0.2, 0.4], "y": [0.1, 0.2], "radius": [0.5, 0.35], "angle": [0.2, -0.6]}
    result = pipeline(
        initializers=[FixedStart(**begin)], optimizer=Adam(rates, betas=(0.5, 0.999)), num_starts=2, num_steps=20
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
            pipeline(**settings, initializers=[FixedStart(y=[0.9])], callbacks=progress)(spots(rows=(0,)), seed=0)
        pipeline(**settings, initializers=[FixedStart(y=[0.0])], callbacks=progress)(spots(rows=(0,)), seed=0)
        pipeline(**settings, initializers=[FixedStart(y=[0.0])], callbacks=[Progress()])(spots(rows=(0,)), seed=0)
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
