"""Rows that a fit loses: pruned ones, and those that break."""

import pytest
import torch
from spot_fits import Cliff, FixedStart, assert_same_path, counting, path, pipeline, spots

from kfit.callbacks import Pruning
from kfit.core import FitError, Prior
from kfit.energies import L2


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
        return pipeline(initializers=[FixedStart(y=y)], num_starts=3, energies=energies, **changes)

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
            initializers=[FixedStart(y=[0.1, -9.0])],
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
            initializers=[FixedStart(y=[0.25, 0.5])],
            num_starts=2,
            energies={"image": L2(), "spike": Spike()},
            num_steps=3,
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
        message = r"^every start of every problem became NaN or infinite by step 0 of the fit$"
        with pytest.raises(FitError, match=message):
            self.fit([0.9] * 6)(spots(rows=(0, 1)), seed=0)

    def test_leave_counts_and_pruning_in_order(self):
        fit = self.fit(self.one_broken, callbacks=[Pruning({2: 2}), Pruning({5: 1})])
        drawn = counting(fit)
        result = fit(spots(rows=(0, 1)), seed=0)
        assert drawn == [6, 5, 5, 4, 4, 4] + [2] * 7
        assert result.all_problem.tolist() == [0, 1]
