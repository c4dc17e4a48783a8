from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import kfit
from kfit.bench.held_out_views import held_out_views
from kfit.core import FitResult, History
from kfit.generators import PoseHead
from kfit.geometry import Symmetry, angles_from_rotation, rotation_error, rotation_from_angles
from kfit.pose import Alternative, CategoryModel
from kfit.pose.hypotheses import alternatives, ambiguity_warning, head_probability
from tests.fixed_head import FixedHead


def ended(azimuth_deg: list[float], energy: list[float], winner: int = 0, elevation_deg: float = 20.0) -> FitResult:
    """A fit of one problem whose starts ended at these azimuths."""
    azimuth = torch.tensor(azimuth_deg).deg2rad()
    ends = {"azimuth": azimuth, "elevation": torch.full_like(azimuth, elevation_deg).deg2rad(), "roll": 0 * azimuth}
    start = torch.arange(len(azimuth)) + 3
    return FitResult(
        values={name: value[winner : winner + 1] for name, value in ends.items()},
        energy=torch.tensor(energy)[winner : winner + 1],
        start=start[winner : winner + 1],
        all_problem=torch.zeros_like(start),
        all_start=start,
        all_energy=torch.tensor(energy),
        all_values=ends,
        history=History(torch.zeros(0), {}, {}),
    )


def found(fit: FitResult, symmetry: Symmetry = "none") -> list[Alternative]:
    return alternatives(fit, torch.eye(3, dtype=torch.float64), symmetry)


HIDDEN = ended([60, 88, 121, 236, 117], [0.60, 0.605, 0.61, 0.62, 0.62])
SHOWN = ended([60, 62, 57, 61, 236], [0.60, 0.605, 0.61, 0.62, 0.98])


def test_a_hidden_handle_is_reported() -> None:
    warning = ambiguity_warning(found(HIDDEN), None, "none")
    assert warning is not None
    assert warning.startswith("ambiguous: the answer has ")
    assert "a pose 61° away" in warning


def test_a_handle_that_shows_is_not() -> None:
    assert ambiguity_warning(found(SHOWN), None, "none") is None


def test_a_symmetric_object_is_sure_where_only_azimuths_differ() -> None:
    assert ambiguity_warning(found(HIDDEN, "y"), None, "y") is None
    assert len(found(HIDDEN, "y")) == 1


def test_each_alternative_tells_weight_and_spread_and_the_answer_is_first() -> None:
    groups = found(ended([0, 10, -10, 120, 130, 118], [2.0, 2.0, 2.0, 1.9, 1.9, 1.9], winner=1))
    # Row 1 won by a vote: its cluster is the first though another weighs more; it reaches row 2 at 20°.
    assert [group.energy for group in groups] == pytest.approx([2.0, 1.9])
    assert sum(group.weight for group in groups) == pytest.approx(1)
    assert groups[0].weight < groups[1].weight
    assert groups[1].sigma_deg == pytest.approx(((100 + 4) / 3) ** 0.5, rel=1e-4)


def test_a_pose_head_warns_where_all_starts_ended_at_one_of_two_poses() -> None:
    picture = torch.ones(1, 3, 8, 8)
    fit = ended([0, 1, 2], [1.0, 1.0, 1.0], elevation_deg=10.0)
    torn = FixedHead().certain_of((0, 10, 0), (180, 10, 0), weights=(0.5, 0.5))
    certain = FixedHead().certain_of((0, 10, 0))
    probability = head_probability(fit, torn(picture)[0], torn, "none")
    assert probability == pytest.approx(0.48, abs=0.04)
    sentence = ambiguity_warning(found(fit), probability, "none")
    assert sentence is not None
    assert f"probability of only {100 * probability:.0f} %" in sentence
    assert ambiguity_warning(found(fit), head_probability(fit, certain(picture)[0], certain, "none"), "none") is None


def test_a_head_without_roll_takes_the_answers_own() -> None:
    upright, rolled = FixedHead(has_roll=False).certain_of((0, 10, 0)), FixedHead().certain_of((0, 10, 0))
    fit = ended([0], [1.0], elevation_deg=10.0)
    fit.values["roll"][:] = math.pi / 2
    picture = torch.ones(1, 3, 8, 8)
    assert head_probability(fit, upright(picture)[0], upright, "none") > 0.8
    assert head_probability(fit, rolled(picture)[0], rolled, "none") < 0.01


def test_the_answer_carries_spread_and_the_word_of_a_head_that_knows_nothing(tiny_model: CategoryModel) -> None:
    torch.manual_seed(0)
    tiny_model.pose_head = PoseHead(channels=(8, 8, 8, 8), hidden_dim=8).eval()
    picture = np.random.default_rng(0).random((40, 40, 3))
    result = tiny_model.pose(picture, mask=np.ones((40, 40)), pipeline=tiny_model.pipeline(4, 1))
    saved = result.to_dict()
    assert saved["ambiguous"] is True
    assert saved["notes"][-1].startswith("ambiguous: ")
    assert all(group["sigma_deg"] >= 0 for group in saved["alternatives"])


@pytest.mark.slow
def test_the_bundled_mug_s_head_doubts_hidden_handles_and_seldom_what_shows() -> None:
    model = kfit.load("mug")
    views, head = held_out_views(model, 150, photo_size=128), model.pose_head
    assert head is not None
    called, right = [], []
    for row, truth in enumerate(views.rotation):
        picture = views.observation.image[row : row + 1]
        with torch.no_grad():
            best = head.rotations[int(head(picture).argmax())]
        azimuth, elevation, _ = angles_from_rotation(best)
        fit = ended([math.degrees(azimuth)], [1.0], elevation_deg=math.degrees(elevation))
        pose_log_probabilities = model.pose_log_probabilities(views.observation[row])
        assert pose_log_probabilities is not None
        called.append(
            ambiguity_warning(found(fit), head_probability(fit, pose_log_probabilities[0], head, "none"), "none")
            is not None
        )
        angles = (fit.values[name].double()[0] for name in ("azimuth", "elevation", "roll"))
        right.append(bool(rotation_error(rotation_from_angles(*angles), truth).rad2deg() < 10))
    warnings, sound = torch.tensor(called).double(), torch.tensor(right) & views.visible
    assert warnings[~views.visible].mean() > 0.4
    assert warnings[sound].mean() < 0.15
