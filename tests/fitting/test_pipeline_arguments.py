"""What a pipeline is given: weights of its terms, and mistakes."""

import pytest
import torch
from spot_fits import SIDE, FixedStart, pipeline, spots, starts_anywhere

from kfit.core import Observation, Prior, Schedule
from kfit.energies import L2, Silhouette
from kfit.initializers import Constant
from kfit.optimizers import Adam


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

    def test_may_be_schedules_and_the_best_is_evaluated_by_the_last(self):
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
        monkeypatch.setattr(fit.energies["mask"], "compare", lambda *args: pytest.fail("compared in vain"))
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
        ("changes", "message"),
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
    def test_are_reported_when_the_pipeline_is_built(self, changes, message):
        with pytest.raises(ValueError, match=message):
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
        fit = pipeline(initializers=[FixedStart(x=[0.0, 0.1])])
        with pytest.raises(ValueError, match=r"FixedStart must give 'x' in shape \(12,\), got \(2,\)"):
            fit(spots(), seed=0)

    def test_an_observation_without_pictures_is_an_error(self):
        with pytest.raises(ValueError, match="observation must hold at least one picture"):
            pipeline()(Observation(torch.zeros(0, 3, SIDE, SIDE, dtype=torch.float64)), seed=0)
