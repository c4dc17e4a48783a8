"""The covariance of a pose: its frame, its units, and what it grows with."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
from torch import Tensor

import kfit
from kfit.core import FitResult, History, Observation, Rendering, Variables
from kfit.geometry import CATEGORIES, Crop
from kfit.pose import CategoryModel
from kfit.pose.calibrating import CHI2_95, covariance_factor
from kfit.pose.confidence import UNMEASURED, Calibration
from kfit.pose.covariance import ANGLE_SD, pose_covariance, rotation_offset, size_log_sd
from kfit.pose.observed_object import ObservedObject
from kfit.pose.placement import placement
from tests.tiny_model import tiny_card

NAMES = ("azimuth", "elevation", "roll")
CAMERA = torch.tensor([[500.0, 0, 159.5], [0, 500.0, 119.5], [0, 0, 1]], dtype=torch.float64)
PATTERNS = torch.rand(6, 3, 16, 16, generator=torch.Generator().manual_seed(1)) - 0.5
NOISE = torch.randn(1, 3, 16, 16, generator=torch.Generator().manual_seed(2))


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Covariances without the factor that cards without a calibration have."""
    monkeypatch.setattr("kfit.pose.covariance.UNMEASURED", 1.0)


def fit_of(azimuth: tuple[float, ...] = (0.5,), energy: tuple[float, ...] = (1.0,), **more: float) -> FitResult:
    """A fit of one problem whose starts ended at these azimuths; the first is the winner."""
    ends: Variables = {"azimuth": torch.tensor(azimuth), "elevation": torch.full((len(azimuth),), 0.4)}
    ends |= {"roll": torch.zeros(len(azimuth)), "shift": torch.zeros(len(azimuth), 2)}
    ends |= {name: torch.full((len(azimuth),), value) for name, value in {"scale": 1.0, **more}.items()}
    start, first = torch.arange(len(azimuth)), {name: value[:1] for name, value in ends.items()}
    energies, history = torch.tensor(energy), History(torch.zeros(0), {}, {})
    return FitResult(first, energies[:1], start[:1], 0 * start, start, energies, ends, history)


def linear(values: Variables) -> Rendering:
    """A picture that grows evenly with each of the six numbers."""
    steps = torch.stack([*(values[name] for name in NAMES), *values["shift"].unbind(1), values["scale"].log()], 1)
    return Rendering(0.5 + torch.einsum("nk,kchw->nchw", steps, PATTERNS.to(steps)))


def observed_of(noise: float = 0.01, intrinsics_from: str = "given", weight: Tensor | None = None) -> ObservedObject:
    picture = linear(fit_of().values).image + noise * NOISE
    blank = np.zeros((240, 320, 3), np.float32)
    crop = Crop((200.0, 90.0), 80.0, 16)
    observation = Observation(picture, weight=weight)
    return ObservedObject(observation, blank, blank[..., 0], crop, CAMERA, intrinsics_from, ())


def covariance(fit: FitResult, category: str = "mug", draw: object = linear, **observed: object) -> Tensor:
    found = pose_covariance(fit, observed_of(**observed), tiny_card(category), draw)  # type: ignore[arg-type]
    return torch.from_numpy(found)


def test_the_matrix_is_symmetric_positive_definite_and_in_the_json(tiny_model: CategoryModel) -> None:
    picture = np.random.default_rng(0).random((40, 40, 3))
    result = tiny_model.pose(picture, mask=np.ones((40, 40)), pipeline=tiny_model.pipeline(4, 1))
    assert result.covariance.shape == (6, 6)
    assert (result.covariance == result.covariance.T).all()
    assert (np.linalg.eigvalsh(result.covariance) > 0).all()
    assert json.loads(json.dumps(result.to_dict()))["covariance"] == result.covariance.tolist()


def test_seven_pictures_are_drawn_once_and_only_when_asked(tiny_model: CategoryModel) -> None:
    rows: list[int] = []
    draw = tiny_model.draw

    def counted(values: Variables) -> Rendering:
        rows.append(len(values["scale"]))
        return draw(values)

    tiny_model.draw = counted  # type: ignore[method-assign]
    picture = np.random.default_rng(0).random((40, 40, 3))
    result = tiny_model.pose(picture, mask=np.ones((40, 40)), pipeline=tiny_model.pipeline(4, 1))
    assert rows == [1]  # the winner's drawing
    assert result.covariance is result.covariance
    assert rows == [1, 7]


def test_an_offset_turns_the_answer_on_the_left_about_the_camera_s_axes() -> None:
    answer = torch.from_numpy(Rotation.random(rng=np.random.default_rng(0)).as_matrix())
    vectors = torch.tensor([[0.3, -0.2, 0.1], [1e-5, 0, 0], [0, 2.0, 1.0]], dtype=torch.float64)
    rotated = torch.from_numpy(Rotation.from_rotvec(vectors.numpy()).as_matrix()) @ answer
    torch.testing.assert_close(rotation_offset(rotated, answer[None], "none"), vectors, atol=1e-7, rtol=1e-6)
    # With symmetry, the part that moves the axis.
    spun = rotated @ torch.from_numpy(Rotation.from_rotvec([0, 1.2, 0]).as_matrix())
    small = rotation_offset(spun, answer[None], "y")
    assert (small @ answer[:, 1]).abs().max() < 1e-9
    torch.testing.assert_close(small, rotation_offset(rotated, answer[None], "y"))
    back = torch.from_numpy(Rotation.from_rotvec(small.numpy()).as_matrix()) @ answer
    torch.testing.assert_close(back[..., 1], rotated[..., 1])


def test_errors_of_fits_to_noisy_pictures_have_this_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Least squares of a linear drawing, whose pixels err independently: the pose's sample covariance."""
    monkeypatch.setattr("kfit.pose.covariance.INFLATION", 1.0)
    monkeypatch.setattr("kfit.pose.covariance.size_log_sd", lambda values, card: 1e-6)
    found, fit, card = covariance(fit_of(), noise=0.02), fit_of(), tiny_card()
    rng, patterns = torch.Generator().manual_seed(3), PATTERNS.flatten(1).double()
    noise = 0.02 * torch.randn(4000, patterns.shape[1], generator=rng, dtype=torch.float64)
    steps = noise @ torch.linalg.pinv(patterns)
    values = {name: value.double().expand(4000, *value.shape[1:]) for name, value in fit.values.items()}
    values |= {name: values[name] + steps[:, n] for n, name in enumerate(NAMES)}
    values |= {"shift": values["shift"] + steps[:, 3:5], "scale": values["scale"] * steps[:, 5].exp()}
    (true, place, _), (rotated, places, _) = (
        placement(v, observed_of().crop, CAMERA, card) for v in (fit.values, values)
    )
    errors = torch.cat([rotation_offset(rotated, true, "none"), places - place], 1)
    deviations = found.diagonal().sqrt()
    sample = errors.mT @ errors / 4000 / deviations[:, None] / deviations
    torch.testing.assert_close(found / deviations[:, None] / deviations, sample, atol=0.1, rtol=0)


@pytest.mark.parametrize("elevation", [math.pi / 2, -math.pi / 2, 3.0])
def test_it_is_positive_definite_from_straight_above_too(elevation: float) -> None:
    fit = fit_of()
    for values in (fit.values, fit.all_values):
        values["elevation"] = torch.full((1,), elevation)
    for category in ("mug", "can"):
        found = covariance(fit, category)
        assert torch.linalg.eigvalsh(found / found.diagonal().outer(found.diagonal()).sqrt()).min() > 1e-6


def test_it_grows_with_what_the_drawing_does_not_explain() -> None:
    clean, noisy = (covariance(fit_of(), noise=noise)[:3, :3].diagonal() for noise in (0.01, 0.04))
    assert (noisy > 4 * clean).all()


def test_pixels_of_no_weight_tell_nothing_be_they_nan() -> None:
    weight = torch.ones(1, 1, 16, 16)
    weight[..., :12] = 0
    known = observed_of(weight=weight)
    hidden = replace(known.observation, image=known.observation.image.where(weight > 0, torch.nan))
    found = pose_covariance(fit_of(), replace(known, observation=hidden), tiny_card(), linear)
    part = torch.from_numpy(found)
    assert (part.diagonal()[:3] > 2 * covariance(fit_of()).diagonal()[:3]).all()


def test_starts_that_end_at_another_pose_make_it_larger() -> None:
    certain, ambiguous, unlikely = (
        covariance(fit_of((0.5, end), (1.0, energy))) for end, energy in ((0.5, 1.0), (1.5, 1.0), (1.5, 2.0))
    )
    up = placement(fit_of().values, observed_of().crop, CAMERA, tiny_card())[0][0, :, 1]
    # Two poses of one weight, one radian apart: half a square radian about the object's vertical axis.
    assert float(up @ (ambiguous - certain)[:3, :3] @ up) == pytest.approx(0.5, rel=1e-3)
    assert torch.linalg.eigvalsh(ambiguous - certain).min() > -1e-9
    assert float(up @ (unlikely - certain)[:3, :3] @ up) < 1e-3


def test_an_angle_that_no_pixel_tells_is_even_over_the_circle() -> None:
    def without_azimuth(values: Variables) -> Rendering:
        return linear(values | {"azimuth": 0 * values["azimuth"] + 0.5})

    found = covariance(fit_of(), draw=without_azimuth)
    up = placement(fit_of().values, observed_of().crop, CAMERA, tiny_card())[0][0, :, 1]
    assert float(up @ found[:3, :3] @ up) == pytest.approx(ANGLE_SD**2, rel=0.02)


def test_the_turn_about_a_symmetry_axis_is_even_and_uncorrelated() -> None:
    found = covariance(fit_of((0.5, 2.0), (1.0, 1.0)), "can")
    up = placement(fit_of().values, observed_of().crop, CAMERA, tiny_card("can"))[0][0, :, 1]
    axis = torch.cat([up, torch.zeros(3, dtype=torch.float64)])
    torch.testing.assert_close(found @ axis, ANGLE_SD**2 * axis)
    assert torch.linalg.eigvalsh(found).min() > 0
    assert torch.linalg.eigvalsh(found)[-2] < 0.5  # what other azimuths of the starts do not make larger


def test_distance_is_as_uncertain_as_what_it_rests_on() -> None:
    place = placement(fit_of().values, observed_of().crop, CAMERA, tiny_card())[1][0]
    ray, mean = place / place.norm(), covariance(fit_of())
    deviation = float((ray @ mean[3:, 3:] @ ray).sqrt() / place.norm())
    least, most = CATEGORIES["mug"].diagonals
    assert deviation == pytest.approx(math.log(most / least) / 6, rel=0.1)
    known = covariance(fit_of(distance=float(place.norm())))
    assert float(ray @ known[3:, 3:] @ ray) < 0.1 * float(ray @ mean[3:, 3:] @ ray)
    assert size_log_sd(fit_of(diagonal=0.2).values, tiny_card()) < size_log_sd(fit_of().values, tiny_card())


def test_a_lens_that_is_estimated_leaves_the_distance_more_uncertain() -> None:
    inputs, tags, estimated = (
        covariance(fit_of(focal=500 / 80), intrinsics_from=source) for source in ("given", "EXIF", "estimated")
    )
    assert inputs[5, 5] < tags[5, 5] < estimated[5, 5]
    assert float(estimated[5, 5]) > 1.5 * float(inputs[5, 5])


def test_the_factor_of_the_card_multiplies_all_but_what_symmetry_leaves_open() -> None:
    fits = {"starts": 1, "steps": 1, "left": 1, "weights": {}}
    for category, kept in (("mug", 0.0), ("bottle", ANGLE_SD**2)):
        card = tiny_card(category)
        plain = pose_covariance(fit_of(), observed_of(), card, linear)
        card = replace(card, calibration={"RGB": Calibration(0.0, {}, 1.0, fits, 9, covariance_factor=4.0)})
        axis = np.zeros((6, 1))
        axis[:3] = placement(fit_of().values, observed_of().crop, CAMERA, card)[0][0, :, 1:2].numpy()
        turn = kept * axis @ axis.T
        np.testing.assert_allclose(
            pose_covariance(fit_of(), observed_of(), card, linear) - turn, 4 * (plain - turn), rtol=1e-6
        )


def test_the_factor_takes_in_95_percent_of_new_answers_whatever_their_distribution() -> None:
    rng = np.random.default_rng(0)
    held = []
    for _ in range(400):  # heavy tails, far from χ²
        distances = rng.pareto(2.0, 60) * 30
        held.append(distances[59] <= CHI2_95 * covariance_factor(distances[:59].tolist()))
    assert 0.93 < np.mean(held) < 0.98
    assert covariance_factor([CHI2_95]) == 1
    assert covariance_factor([]) == UNMEASURED


def test_an_answer_copied_with_another_fit_computes_anew(tiny_model: CategoryModel) -> None:
    picture = np.random.default_rng(0).random((40, 40, 3))
    result = tiny_model.pose(picture, mask=np.ones((40, 40)), pipeline=tiny_model.pipeline(4, 1))
    assert result.covariance is not None
    other = replace(result, find_covariance=lambda: np.eye(6))
    assert (other.covariance == np.eye(6)).all()


@pytest.mark.slow
def test_most_truths_of_held_out_views_lie_in_the_ellipsoid() -> None:
    from kfit.bench.covariance import pose_offsets, squared_mahalanobis
    from kfit.bench.held_out_views import held_out_views, rotation_errors

    model = kfit.load("mug")
    views = held_out_views(model, 12, seed=9, kind="table")
    _, results = rotation_errors(model, views)
    inside = squared_mahalanobis(*pose_offsets(model, views, results)) < CHI2_95
    assert 0.6 <= float(inside.double().mean()) <= 1.0
