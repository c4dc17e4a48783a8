"""The steps of single optimizers: the rates, lines and dampings that they choose."""

import pytest
import torch
from test_optimizers import energy_of, evaluation_of, quadratic, seeds, spot, starts, valley, walk

from kfit.optimizers import LBFGS, Adam, LevenbergMarquardt


class TestAdam:
    def test_asks_for_one_evaluation_a_step(self):
        calls, raw, optimizer = [], starts(), Adam(0.1)
        memory = optimizer.init(raw, seeds())
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
            energy_of(valley, leaves).sum().backward()
            theirs.step()
        ours, _ = walk(Adam({"x": 0.07, "y": 0.02}), valley, starts(), 20)
        for name, value in ours.items():
            torch.testing.assert_close(value, leaves[name].detach(), rtol=1e-11, atol=1e-11)

    def test_lets_its_rates_fall_as_torch_s_exponential_schedule_does(self):
        leaf, y = starts()["x"].clone().requires_grad_(), starts()["y"]
        theirs = torch.optim.Adam([leaf], lr=0.07, betas=(0.7, 0.95))
        falling = torch.optim.lr_scheduler.ExponentialLR(theirs, 0.9)
        for _ in range(20):
            (leaf.grad,) = torch.autograd.grad(quadratic(leaf, y).square().sum(), leaf)
            theirs.step()
            falling.step()
        ours, _ = walk(Adam({"x": 0.07, "y": 0.0}, (0.7, 0.95), 0.9), quadratic, starts(), 20)
        torch.testing.assert_close(ours["x"], leaf.detach())

    def test_refuses_rates_that_grow_or_vanish(self):
        for decay in (0.0, 1.01):
            with pytest.raises(ValueError, match="Adam: decay"):
                Adam(decay=decay)

    def test_stays_close_to_torch_s_own_in_single_precision(self):
        leaf = starts()["x"].float().requires_grad_()
        theirs = torch.optim.Adam([leaf], lr=0.05, betas=(0.5, 0.999))
        y = starts()["y"].float()
        for _ in range(20):
            theirs.zero_grad()
            quadratic(leaf, y).square().sum().backward()
            theirs.step()
        ours, _ = walk(Adam(0.05), lambda x, y: quadratic(x, 0 * y), {"x": starts()["x"].float(), "y": y}, 20)
        torch.testing.assert_close(ours["x"], leaf.detach(), rtol=1e-4, atol=1e-4)

    def test_first_moves_each_number_by_its_rate(self):
        raw, _ = walk(Adam({"x": 0.05, "y": 0.02}), quadratic, starts(), 1)
        torch.testing.assert_close((raw["x"] - starts()["x"]).abs(), torch.full((5, 2), 0.05, dtype=torch.float64))
        torch.testing.assert_close((raw["y"] - starts()["y"]).abs(), torch.full((5,), 0.02, dtype=torch.float64))

    @pytest.mark.parametrize("rates", [0.0, -1.0, float("nan"), {"x": 0.1, "y": -0.1}])
    def test_refuses_rates_that_move_nothing_or_uphill(self, rates):
        with pytest.raises(ValueError, match=r"Adam: rates (must be above 0|of y must be finite and at least 0)"):
            Adam(rates)

    def test_holds_a_variable_of_rate_zero(self):
        raw, _ = walk(Adam({"x": 0.05, "y": 0.0}), quadratic, starts(), 3)
        torch.testing.assert_close(raw["y"], starts()["y"], rtol=0, atol=0)
        assert not torch.equal(raw["x"], starts()["x"])

    @pytest.mark.parametrize("betas", [(1.0, 0.9), (0.9, -0.1)])
    def test_refuses_betas_outside_their_range(self, betas):
        with pytest.raises(ValueError, match="Adam: betas"):
            Adam(betas=betas)

    @pytest.mark.parametrize(
        ("rates", "message"), [({"x": 0.1, "z": 0.1, "y": 0.1}, "unknown z"), ({"x": 0.1}, "nothing for y")]
    )
    def test_refuses_rates_that_do_not_name_the_variables(self, rates, message):
        with pytest.raises(ValueError, match=f"rates: {message}; the names are x, y"):
            Adam(rates).init(starts(), seeds())


class TestLBFGS:
    def test_takes_few_steps_and_pictures_to_the_end_of_the_valley(self):
        calls, raw, optimizer = [], starts(), LBFGS()
        memory = optimizer.init(raw, seeds())
        for _ in range(28):
            raw, _, memory = optimizer.step(evaluation_of(valley, calls), raw, torch.zeros(5).long(), memory)
        assert energy_of(valley, raw).max() < 1e-9
        assert sum(rows for _, rows in calls) < 5 * 28 * 3

    def test_gets_as_far_as_torch_s_own_with_its_strong_line_search(self):
        for row in range(5):
            leaves = {name: value[row : row + 1].clone().requires_grad_() for name, value in starts().items()}
            theirs = torch.optim.LBFGS(list(leaves.values()), max_iter=25, line_search_fn="strong_wolfe")

            def closure(theirs=theirs, leaves=leaves):
                theirs.zero_grad()
                energy = energy_of(valley, leaves).sum()
                energy.backward()
                return energy

            theirs.step(closure)
            ours, _ = walk(LBFGS(), valley, {name: value[row : row + 1] for name, value in starts().items()}, 40)
            for name, value in ours.items():
                torch.testing.assert_close(value, leaves[name].detach(), rtol=0, atol=1e-4)

    def test_first_moves_no_number_by_more_than_it_may(self):
        raw, _ = walk(LBFGS(first_step=0.01), quadratic, starts(), 1)
        moved = torch.cat([(raw["x"] - starts()["x"]).abs(), (raw["y"] - starts()["y"]).abs()[:, None]], 1)
        torch.testing.assert_close(moved.amax(1), torch.full((5,), 0.01, dtype=torch.float64))

    def test_steps_back_from_where_there_is_no_number(self):
        def root(x, y):
            return torch.cat([(x + 3).log(), y[:, None]], 1)  # least at x = −2, no number below −3

        raw, _ = walk(LBFGS(first_step=10.0), root, starts(), 40)
        torch.testing.assert_close(raw["x"], torch.full((5, 2), -2.0, dtype=torch.float64), rtol=0, atol=1e-6)

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"history": 0}, "(history must be at least 1|max_trials must be at least 1)"),
            ({"max_trials": 0}, "(history must be at least 1|max_trials must be at least 1)"),
            ({"first_step": 0.0}, "first_step must be above 0"),
        ],
    )
    def test_refuses_settings_that_lead_nowhere(self, settings, message):
        with pytest.raises(ValueError, match=f"LBFGS: {message}"):
            LBFGS(**settings)


class TestLevenbergMarquardt:
    def test_solves_a_linear_problem_in_few_steps(self):
        raw, _ = walk(LevenbergMarquardt(1e-6), quadratic, starts(), 2)
        assert energy_of(quadratic, raw).max() < 1e-10

    def test_draws_one_picture_for_each_number_and_three_more(self):
        calls, raw, optimizer = [], starts(), LevenbergMarquardt(1e-6)
        optimizer.step(evaluation_of(quadratic, calls), raw, torch.zeros(5).long(), optimizer.init(raw, seeds()))
        assert calls == [("gradient", 5), ("residuals", 5 * 4), ("value", 5)]

    def test_gets_as_far_as_scipy_s_from_the_same_starts(self):
        optimize = pytest.importorskip("scipy.optimize")
        ours, _ = walk(LevenbergMarquardt(), spot, starts(), 30)
        for row in range(5):
            start = torch.cat([starts()["x"][row], starts()["y"][row : row + 1]]).numpy()

            def residuals(place):
                place = torch.from_numpy(place)
                return spot(place[None, :2], place[2:]).numpy()[0]

            theirs = torch.from_numpy(optimize.least_squares(residuals, start, method="lm").x)
            torch.testing.assert_close(torch.cat([ours["x"][row], ours["y"][row : row + 1]]), theirs, atol=1e-5, rtol=0)

    def test_leaves_numbers_that_change_nothing_where_they_are(self):
        raw, _ = walk(LevenbergMarquardt(), lambda x, y: torch.stack([x[:, 0] - 1, 0 * y], 1), starts(), 5)
        torch.testing.assert_close(raw["x"][:, 0], torch.ones(5, dtype=torch.float64))
        torch.testing.assert_close(raw["x"][:, 1], starts()["x"][:, 1])
        torch.testing.assert_close(raw["y"], starts()["y"])

    @pytest.mark.parametrize("settings", [{"damping": 0.0}, {"max_trials": 0}])
    def test_refuses_settings_that_lead_nowhere(self, settings):
        with pytest.raises(
            ValueError, match=r"LevenbergMarquardt: (damping must be above 0|max_trials must be at least 1)"
        ):
            LevenbergMarquardt(**settings)
