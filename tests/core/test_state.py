"""The plain values of a fit."""

from collections import namedtuple

import pytest
import torch

from kfit.core import FitResult, FitState, History, Observation, Rendering
from kfit.fitting.recorder import Recorder

GOOD = {
    "image": torch.rand(2, 3, 4, 5),
    "mask": torch.rand(2, 1, 4, 5),
    "depth": torch.rand(2, 1, 4, 5),
    "weight": torch.ones(2, 1, 4, 5),
    "intrinsics": torch.eye(3).expand(2, 3, 3),
}
Pair = namedtuple("Pair", "first second")


def state(rows=4):
    problem = torch.arange(rows) // 2
    raw = {"x": torch.arange(rows) + 0.5, "code": torch.arange(3.0 * rows).view(rows, 3)}
    energy = torch.arange(rows) * 1.0
    memory = {"mean": dict(raw), "deep": [(energy + 10, Pair(energy + 20, None))], "settings": "kept"}
    return FitState(3, 9, problem, torch.arange(rows) % 2, raw, raw, energy, {"a": energy}, energy, raw, memory)


def test_a_complete_observation_is_accepted():
    observation = Observation(**GOOD, keys=(4, 5))
    assert observation.num_problems == 2
    assert observation.field("depth") is GOOD["depth"]


@pytest.mark.parametrize("name", GOOD)
def test_an_observation_of_a_wrong_shape_is_refused_by_the_name_of_the_field(name):
    with pytest.raises(ValueError, match=rf"^{name} must have shape"):
        Observation(**{**GOOD, name: GOOD[name][0]})  # with an axis more, an image is a volume


def test_a_volume_has_fields_of_its_size():
    volume = torch.rand(2, 1, 3, 4, 5)
    assert Observation(volume, weight=torch.ones(2, 1, 3, 4, 5)).num_problems == 2
    with pytest.raises(ValueError, match=r"^weight must have shape \(2, 1, 3, 4, 5\), got \(2, 1, 4, 5\)"):
        Observation(volume, weight=torch.ones(2, 1, 4, 5))


@pytest.mark.parametrize("name", [name for name in GOOD if name != "image"])
def test_a_field_with_another_number_of_rows_is_refused_by_name(name):
    with pytest.raises(ValueError, match=rf"^{name} must have shape \(2, "):
        Observation(**{**GOOD, name: GOOD[name][:1]})


@pytest.mark.parametrize("name", GOOD)
def test_a_field_that_is_no_tensor_is_refused_by_name(name):
    with pytest.raises(TypeError, match=rf"^{name} must be a tensor.*got list"):
        Observation(**{**GOOD, name: [1.0]})


@pytest.mark.parametrize("name", ["image", "mask", "depth"])
def test_pictures_in_whole_numbers_are_refused_by_name(name):
    with pytest.raises(TypeError, match=rf"^{name} must be a floating-point tensor, got torch.uint8"):
        Observation(**{**GOOD, name: GOOD[name].to(torch.uint8)})


def test_keys_must_be_one_a_picture():
    with pytest.raises(ValueError, match=r"^keys .* 2 problems, got 3"):
        Observation(GOOD["image"], keys=(1, 2, 3))


@pytest.mark.parametrize("kind", [Observation, Rendering])
def test_a_field_that_is_not_there_is_an_error_that_lists_those_that_are(kind):
    held = kind(GOOD["image"], GOOD["mask"])
    for name in ("depth", "nonsense", "num_problems"):
        with pytest.raises(ValueError, match=rf"has no '{name}'; it has image, mask$"):
            held.field(name)


class TestProblemsOfAnObservation:
    VIEWS = Observation(torch.arange(6.0).view(6, 1, 1, 1), torch.rand(6, 1, 1, 1), keys=(7, 8, 9), views=2)

    def test_are_taken_with_all_their_views_and_their_keys(self):
        for index in (slice(1, 3), [1, 2], torch.tensor([1, 2]), torch.tensor([False, True, True])):
            part = self.VIEWS[index]
            assert part.image.flatten().tolist() == [2, 3, 4, 5]
            assert torch.equal(part.mask, self.VIEWS.mask[2:])
            assert (part.keys, part.views, part.depth) == ((8, 9), 2, None)
        assert self.VIEWS[1].image.flatten().tolist() == [2, 3]
        assert self.VIEWS[1].keys == (8,)
        assert Observation(**GOOD)[0].keys == ()

    def test_are_joined_in_their_order(self):
        joined = Observation.cat([self.VIEWS[2], self.VIEWS[0]])
        assert joined.image.flatten().tolist() == [4, 5, 0, 1]
        assert (joined.keys, joined.views) == ((9, 7), 2)

    def test_are_joined_only_where_they_have_the_same_fields_and_views(self):
        with pytest.raises(ValueError, match="all have a mask, or none"):
            Observation.cat([Observation(GOOD["image"]), Observation(GOOD["image"], GOOD["mask"])])
        with pytest.raises(ValueError, match=r"must have 2 views each, got \[2, 1\]"):
            Observation.cat([self.VIEWS, self.VIEWS.first_views()])


def test_mapping_reaches_each_tensor_and_nothing_else():
    doubled = Observation(**GOOD, keys=(4, 5)).map(torch.Tensor.double)
    assert doubled.keys == (4, 5)
    assert {doubled.field(name).dtype for name in GOOD} == {torch.float64}


@pytest.mark.parametrize(
    "index", [torch.tensor([3, 1]), torch.tensor([False, True, False, True])], ids=["long", "bool"]
)
def test_keeping_rows_keeps_them_everywhere_and_with_their_start_numbers(index):
    kept = state().keep(index)
    rows = index if index.dtype == torch.long else torch.tensor([1, 3])
    assert (kept.step, kept.num_steps) == (3, 9)
    assert kept.start.tolist() == [1, 1]
    assert kept.problem.tolist() == (rows // 2).tolist()
    for name, whole in state().raw.items():
        for held in (kept.raw, kept.values, kept.best_values, kept.optimizer["mean"]):
            torch.testing.assert_close(held[name], whole[rows])
    for held in (kept.energy, kept.best_energy, kept.terms["a"]):
        assert held.tolist() == rows.tolist()


def test_keeping_rows_reaches_into_the_optimizer_s_nested_memory():
    kept = state().keep(torch.tensor([2]))
    (first, pair), *others = kept.optimizer["deep"]
    assert not others
    assert first.tolist() == [12]
    assert isinstance(pair, Pair)
    assert pair.first.tolist() == [22]
    assert pair.second is None
    assert kept.optimizer["settings"] == "kept"


def test_keeping_nothing_leaves_no_rows_and_the_original_is_untouched():
    whole = state()
    assert len(whole.keep(torch.zeros(4, dtype=torch.bool)).problem) == 0
    assert len(whole.problem) == 4


class TestARecorder:
    def test_holds_nan_where_a_row_has_left(self):
        recorder, now = Recorder(2, 2), state()
        recorder.record(now)
        recorder.record(now.keep(torch.tensor([1, 2])))
        history = recorder.history()
        assert history.energy.shape == history.terms["a"].shape == history.values["x"].shape == (2, 2, 2)
        assert history.values["code"].shape == (2, 2, 2, 3)
        torch.testing.assert_close(history.energy[0], torch.tensor([[0.0, 1.0], [2.0, 3.0]]))
        gone = torch.tensor([[True, False], [False, True]])
        for held in (history.energy, history.terms["a"], history.values["x"], history.values["code"][..., 0]):
            assert held[1].isnan().tolist() == gone.tolist()
            torch.testing.assert_close(held[1][~gone], held[0][~gone])

    def test_holds_nan_at_the_steps_at_which_a_term_was_not_computed(self):
        recorder, now = Recorder(2, 2), state()
        now.terms = {"b": now.energy}
        for terms in ({"b": now.energy}, {"a": now.energy, "b": now.energy}, {"b": now.energy}):
            now.terms = terms
            recorder.record(now)
        terms = recorder.history().terms
        assert terms["a"].shape == terms["b"].shape == (3, 2, 2)
        assert terms["a"].isnan().flatten(1).all(1).tolist() == [True, False, True]

    def test_drops_rows_whose_energy_is_no_number_and_reports_them(self):
        recorder, now = Recorder(2, 2), state()
        assert recorder.drop(now) is now
        now.energy = torch.tensor([0.0, torch.nan, 2.0, torch.inf])
        left = recorder.drop(now)
        assert recorder.dropped == [(0, 1, 3), (1, 1, 3)]
        assert left.energy.tolist() == [0, 2]
        assert left.optimizer["mean"]["x"].tolist() == [0.5, 2.5]


def test_of_a_fit_of_several_problems_one_can_be_had_alone():
    values, rows = {"x": torch.tensor([1.0, 2.0])}, torch.tensor([0, 1, 1, 0])
    path = torch.arange(12.0).view(3, 2, 2)
    result = FitResult(
        values, torch.tensor([0.1, 0.2]), torch.tensor([3, 4]), rows, torch.arange(4), torch.arange(4.0),
        {"x": torch.arange(4.0)}, History(path, {"a": 2 * path}, {"x": 3 * path}, 5), [(0, 1, 2), (1, 0, 1)], 24,
    )  # fmt: skip
    assert [float(part.energy) for part in result] == [pytest.approx(0.1), pytest.approx(0.2)]
    one = result[1]
    assert one.values == {"x": torch.tensor([2.0])}
    assert (one.energy.tolist(), one.start.tolist()) == ([pytest.approx(0.2)], [4])
    assert one.all_problem.tolist() == [0, 0]
    assert one.all_start.tolist() == [1, 2]
    assert one.all_values["x"].tolist() == [1.0, 2.0]
    assert one.history.energy.tolist() == [[[2, 3]], [[6, 7]], [[10, 11]]]
    assert torch.equal(one.history.terms["a"], 2 * one.history.energy)
    assert torch.equal(one.history.values["x"], 3 * one.history.energy)
    assert one.history.value_stride == 5
    assert one.dropped == [(0, 0, 1)]
    with pytest.raises(IndexError, match="between 0 and 1, got 2"):
        result[2]
    assert one.num_evaluations == 24
