from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from model_file import card_of, put_card

import kfit
from kfit.core import FitResult, History
from kfit.geometry import Crop
from kfit.models import read_card
from kfit.pose import Alternative, CategoryModel
from kfit.pose.calibrating import calibrate, calibrated, cross_validated, reliability
from kfit.pose.confidence import UNMEASURED, Calibration, confidence, evidence, how_fitted
from kfit.pose.observed_object import cut_off, too_small

FITS = {"starts": 4, "steps": 2, "left": 2, "weights": {"l1": 1.0, "prior": 0.5}}


def fit_of(
    weights: dict[str, float] = FITS["weights"], steps: int = 2, left: int = 2, energy: float = 1.0
) -> FitResult:
    """A fit of one problem from 4 starts, of which some are left, with a history that is of these weights."""
    rng = torch.Generator().manual_seed(0)
    terms = {name: torch.rand(steps + 1, 1, 4, generator=rng) for name in weights}
    for term in terms.values():
        term[-1, :, left:] = torch.nan
    total = sum(weight * terms[name] for name, weight in weights.items())
    rows = torch.zeros(left, dtype=torch.long)
    return FitResult({}, torch.tensor([energy]), rows[:1], rows, rows, torch.rand(left), {}, History(total, terms, {}))


def found(weight: float = 0.9, energy: float = 1.0, sigma_deg: float = 2.0) -> list[Alternative]:
    turn = np.eye(3)
    return [Alternative(turn, energy, weight, sigma_deg), Alternative(turn, 1.2 * energy, 1 - weight, 0.0)]


def made_up(count: int, seed: int = 0) -> tuple[list[dict[str, float]], list[bool], np.ndarray]:
    """Answers whose chance of being right is σ(1 + 1.5 x), with a y that tells nothing; and these chances."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(2.0, 3.0, count), rng.normal(0.0, 0.1, count)
    chance = 1 / (1 + np.exp(-(1 + 1.5 * (x - 1.5))))
    return [{"x": a, "y": b} for a, b in zip(x, y, strict=True)], (rng.random(count) < chance).tolist(), chance


def test_the_logistic_model_finds_the_one_that_made_the_answers() -> None:
    features, right, chance = made_up(4000)
    bias, coefficients = calibrated(features, right)
    assert coefficients["x"] == pytest.approx(1.5, rel=0.1)
    assert bias == pytest.approx(1 - 1.5 * 1.5, abs=0.25)
    model = Calibration(bias, coefficients, 1.0, FITS, 9)
    assert np.abs([model.probability(one) for one in features] - chance).max() < 0.05


def test_the_logistic_model_is_the_penalised_maximum_that_torch_finds() -> None:
    features, right, _ = made_up(60)
    rows = torch.tensor([list(one.values()) for one in features], dtype=torch.float64)[:, :1]
    scaled = (rows - rows.mean(0)) / rows.std(0, correction=0)
    yes = torch.tensor(right)
    target = torch.where(yes, (yes.sum() + 1) / (yes.sum() + 2), 1 / ((~yes).sum() + 2)).double()
    x = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    solver = torch.optim.LBFGS([x], max_iter=200, tolerance_grad=1e-10, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        solver.zero_grad()
        logit = x[0] + scaled[:, 0] * x[1]
        loss = torch.nn.functional.binary_cross_entropy_with_logits(logit, target, reduction="sum") + 0.5 * x[1] ** 2
        loss.backward()
        return loss

    solver.step(closure)
    _, coefficients = calibrated([{"x": one["x"]} for one in features], right)
    assert coefficients["x"] == pytest.approx(float(x[1].detach() / rows.std(0, correction=0)), rel=1e-3)


def test_held_out_answers_are_right_as_often_as_predicted() -> None:
    features, right, chance = made_up(2000)
    checked = reliability(cross_validated(features, right), right)
    assert checked["calibration error"] < 0.03
    assert checked["brier"] == pytest.approx(float((chance * (1 - chance)).mean()), rel=0.1)
    assert checked["brier"] < checked["brier of the share"]
    assert sum(row["number"] for row in checked["bins"]) == 2000


def test_what_speaks_for_an_answer_never_comes_to_speak_against_it() -> None:
    features, right, _ = made_up(200)
    _, coefficients = calibrated(features, [not yes for yes in right])
    assert coefficients["x"] == 0


def test_views_without_a_failure_promise_no_certainty() -> None:
    features, _, _ = made_up(18)
    bias, coefficients = calibrated(features, [True] * 18)
    # Laplace's rule of succession: (18 + 1) / (18 + 2).
    probabilities = [Calibration(bias, coefficients, 1.0, FITS, 9).probability(one) for one in features]
    assert probabilities == pytest.approx([0.95] * 18, abs=1e-3)


def test_reliability_tells_each_bin_and_their_mean_gap() -> None:
    table = reliability([0.2, 0.4, 0.85, 0.85, 1.0], [False, True, True, False, True])
    assert [(row["from"], row["number"]) for row in table["bins"]] == [(0.0, 2), (0.8, 2), (0.95, 1)]
    assert [row["right"] for row in table["bins"]] == [0.5, 0.5, 1.0]
    assert table["calibration error"] == pytest.approx((2 * 0.2 + 2 * 0.35) / 5)
    assert table["brier"] == pytest.approx(np.mean(np.square([0.2, 0.6, 0.15, 0.85, 0.0])))
    assert table["brier of the share"] == pytest.approx(0.24)


def test_evidence_is_the_more_the_surer_and_finite_at_its_ends() -> None:
    certain, torn = evidence(found(0.9), 0.9), evidence(found(0.6, 1.5, 10.0), 0.3)
    assert set(certain) == {"weight", "energy", "agreement", "looks"}
    assert all(certain[name] > torn[name] for name in certain)
    alone = evidence(found(1.0)[:1], None)
    assert "looks" not in alone
    assert all(math.isfinite(one) for one in [*alone.values(), *evidence(found(0.0), 0.0).values()])


def test_a_calibration_covers_fits_in_its_own_way_and_no_others() -> None:
    model = Calibration(1.0, {"energy": 1.0}, 2.0, FITS, 9)
    assert model.covers(fit_of())
    assert how_fitted(fit_of(), FITS["weights"]) == FITS
    assert not model.covers(fit_of(steps=3))
    assert not model.covers(fit_of(left=3))
    assert not model.covers(fit_of({"l1": 1.0, "prior": 0.6}))
    assert not model.covers(fit_of({"l1": 1.0}))
    assert not model.covers(replace(fit_of(), history=History(torch.zeros(0), {}, {})))


def test_confidence_is_the_model_s_or_the_weight_and_then_says_so() -> None:
    model = Calibration(1.0, {"energy": 1.0}, 2.0, FITS, 9)
    assert confidence(model, fit_of(), found(), None) == (pytest.approx(1 / (1 + math.exp(-1))), None)
    probability, note = confidence(None, fit_of(), found(), None)
    assert probability == 0.9
    assert note is not None
    assert note.startswith("confidence not calibrated, as the model's card")
    probability, note = confidence(model, fit_of(steps=3), found(energy=5.0), None)
    assert probability == 0.9
    assert note is not None
    assert note.startswith("confidence not calibrated for a fit in another way")


def test_a_poor_drawing_is_reported_where_the_fit_is_the_model_s_own() -> None:
    model = Calibration(1.0, {"energy": 1.0}, 2.0, FITS, 9)
    value, note = confidence(model, fit_of(), found(energy=2.5), None)
    assert value == 0.5  # and not the 0.52 of the model
    assert model.probability({"energy": -math.log(2.5)}) > 0.5
    assert note is not None
    assert note.startswith(
        "the drawing explains the picture poorly: of 9 held-out views 99 % have an energy below 2.00"
    )
    assert confidence(model, fit_of(), found(energy=1.9), None)[1] is None


def test_a_poor_drawing_is_reported_where_fits_with_depth_lack_calibration() -> None:
    terms = {"l1": torch.tensor([[[9.0, 0.5]], [[3.0, 0.1]]]), "depth": torch.ones(2, 1, 2)}
    fit = replace(fit_of(), history=History(terms["l1"] + terms["depth"], terms, {}))
    for start, energy, poor in ((0, 4.0, True), (1, 1.1, False)):
        fit = replace(fit, start=torch.tensor([start]))
        known = Calibration(1.0, {}, 2.0, {**FITS, "weights": {"l1": 1.0}}, 9)
        value, note = confidence(None, fit, found(energy=energy), None, known)
        assert value == (0.5 if poor else known.probability({})) < 0.9
        assert note is not None
        assert note.startswith("confidence not calibrated, as the model's card")
        assert ("explains the look of the picture poorly" in note) == poor


def test_of_equal_energies_the_look_of_the_own_problem_counts() -> None:
    shift = torch.tensor([[[9.0], [1.0]]])
    terms, rows = {"l1": shift, "depth": 10 - shift}, torch.arange(2)
    fit = replace(
        fit_of(), energy=torch.full((2,), 10.0), start=rows * 0, all_problem=rows, all_start=rows * 0,
        all_energy=torch.full((2,), 10.0), history=History(torch.full((1, 2, 1), 10.0), terms, {}),
    )  # fmt: skip
    known = Calibration(1.0, {}, 2.0, {**FITS, "weights": {"l1": 1.0}}, 9)
    for problem, expected in ((0, 0.5), (1, known.probability({}))):
        assert confidence(None, fit[problem], found(energy=10.0), None, known)[0] == expected


def test_a_card_keeps_its_calibrations(tiny_file: Path) -> None:
    made, right, _ = made_up(30)
    features = [{"energy": one["x"], "looks": one["y"]} for one in made]
    card = read_card(tiny_file)
    assert card.calibration == {}
    calibrated = calibrate(features, right, list(range(30)), FITS, 7, [25.184] * 20)
    card = replace(card, calibration={"RGB": calibrated})
    put_card(tiny_file, card.to_json())
    again = read_card(tiny_file).calibration["RGB"]
    assert again == calibrated
    assert again.views == 30
    assert again.energy_99 == pytest.approx(28.71)
    assert again.covariance_factor == pytest.approx(2)


def test_a_calibration_from_before_covariances_were_measured_is_read(tiny_file: Path) -> None:
    put_card(tiny_file, card_of(tiny_file) | {"calibration": {"RGB": GOOD}})
    assert "covariance_factor" not in GOOD
    assert read_card(tiny_file).calibration["RGB"].covariance_factor == UNMEASURED


def test_a_card_from_before_calibrations_is_read(tiny_file: Path) -> None:
    saved = card_of(tiny_file)
    del saved["calibration"]
    put_card(tiny_file, saved)
    assert read_card(tiny_file).calibration == {}


GOOD = {"bias": 0.0, "coefficients": {"energy": 1.0}, "energy_99": 1.0, "fits": FITS, "views": 9, "measured": {}}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"HDR": GOOD}, "unknown HDR; the names are RGB, RGB-D"),
        ([], "must be a dict"),
        ({"RGB": {}}, "a calibration must hold just bias, coefficients"),
        ({"RGB": GOOD | {"coefficients": {"luck": 1.0}}}, "unknown luck; the names are agreement, energy"),
        ({"RGB": GOOD | {"bias": "high"}}, "must be finite numbers"),
        ({"RGB": GOOD | {"energy_99": math.inf}}, "must be finite numbers"),
        ({"RGB": GOOD | {"fits": {}}}, "must be finite numbers"),
    ],
)
def test_a_calibration_that_cannot_be_used_gets_a_sentence(tiny_file: Path, wrong: object, sentence: str) -> None:
    put_card(tiny_file, card_of(tiny_file) | {"calibration": wrong})
    with pytest.raises(ValueError, match=sentence) as refused:
        read_card(tiny_file)
    assert "tiny.safetensors holds a calibration that cannot be used" in str(refused.value)


def test_a_pose_has_calibrated_confidence_in_the_model_s_own_fit_alone(tiny_model: CategoryModel) -> None:
    image, mask = np.random.default_rng(0).random((80, 90, 3)), np.zeros((80, 90))
    mask[5:70, 10:75] = 1
    first = tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(4, 2))
    assert any(note.startswith("confidence not calibrated") for note in first.notes)
    assert first.confidence == first.alternatives[0].weight
    weights = {name: weight for name, weight in tiny_model.pipeline().weights.items() if isinstance(weight, float)}
    fits = how_fitted(first.fit, weights)
    for high, warned in ((1e6, False), (1e-6, True)):
        calibration = {"RGB": Calibration(-1.0, {}, high, fits, 9)}
        tiny_model.card = replace(tiny_model.card, calibration=calibration)
        own = tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(4, 2))
        assert own.confidence == pytest.approx(1 / (1 + math.e))
        assert not any("not calibrated" in note for note in own.notes)
        assert any("explains the picture poorly" in note for note in own.notes) == warned
    other = tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(4, 3))
    assert other.confidence == other.alternatives[0].weight
    assert any("in another way" in note for note in other.notes)


def test_a_mask_at_the_border_is_reported_and_one_inside_is_not() -> None:
    mask = np.zeros((20, 30))
    mask[5:10, 5:10] = 1
    assert cut_off(mask) is None
    mask[8, 10:] = 1
    assert str(cut_off(mask)).startswith("the mask touches the picture's border (right): the object may be cut off")
    mask[:, 12], mask[:, 0] = 1, 1
    assert "(left, right, top and bottom)" in str(cut_off(mask))


def test_an_object_of_fewer_pixels_than_its_drawing_is_reported() -> None:
    mask = np.zeros((200, 200))
    mask[50:80, 50:99] = 1  # 49 · 1.3 = 63.7
    assert "the longer side of its box has 49 pixels, and the drawing that is fitted to it 49" in str(
        too_small(Crop.around(mask, 64))
    )
    mask[50:80, 99] = 1
    assert too_small(Crop.around(mask, 64)) is None


def test_a_photo_s_answer_tells_what_is_cut_off_and_small(tiny_model: CategoryModel) -> None:
    image, mask = np.random.default_rng(0).random((80, 90, 3)), np.zeros((80, 90))
    mask[:20, 10:40] = 1
    notes = tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(2, 1)).notes
    assert any("border (top)" in note for note in notes)
    assert any("has 30 pixels" in note for note in notes)


@pytest.mark.parametrize("category", ["laptop", "mug"])
def test_a_bundled_calibration_is_of_the_model_s_own_fit(category: str) -> None:
    model = kfit.load(category)
    for kind, one in model.card.calibration.items():
        pipeline = model.pipeline(depth=kind == "RGB-D")
        assert one.fits["weights"] == {name: weight for name, weight in pipeline.weights.items() if weight}
        assert (one.fits["starts"], one.fits["steps"]) == (pipeline.num_starts, pipeline.num_steps)
