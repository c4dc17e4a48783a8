"""Whether a tracked pose is trusted."""

import pytest
import torch

from kfit.geometry import rotation_from_angles
from kfit.tracking.track_quality import TrackQuality


def rotation(azimuth_deg):
    zero = torch.tensor(0.0)
    return rotation_from_angles(torch.deg2rad(torch.tensor(float(azimuth_deg))), zero, zero)


@pytest.fixture
def quality():
    return TrackQuality("none", rotation(0), 1.0, 1.0)


def test_a_frame_like_the_last_is_trusted(quality):
    assert quality.assess(1.1, 0.9, rotation(5), 0.9) == (False, 0.9)


@pytest.mark.parametrize(("energy", "overlap"), [(2.1, 0.9), (1.0, 0.5)], ids=["energy", "overlap"])
def test_twice_the_energy_or_little_overlap_means_lost(quality, energy, overlap):
    assert quality.assess(energy, overlap, rotation(5), 0.9) == (True, 0.5)


def test_a_mask_that_fits_badly_is_doubtful_and_not_lost(quality):
    assert quality.assess(1.0, 0.8, rotation(0), 0.9) == (False, 0.5)


def test_a_jump_is_doubtful_for_five_frames(quality):
    found = [quality.assess(1.0, 0.9, rotation(90), 0.9)[1] for _ in range(7)]
    assert found == [0.5] * 5 + [0.9] * 2


def test_the_expected_energy_follows_slowly_and_the_fitted_one_stays(quality):
    for _ in range(30):
        quality.learn(1.9)
    assert quality.expected == pytest.approx(1.9, rel=0.01)
    assert quality.assess(2.2, 0.9, rotation(0), 0.9) == (False, 0.5)


def test_another_things_energy_is_not_learned_from_a_frame_that_is_fitted_anew(quality):
    anew, other = quality.fitted_anew(1.5), quality.fitted_anew(3.0)
    assert (anew.expected, anew.fitted) == (1.5, 1.5)
    assert (other.expected, other.fitted) == (1.0, 3.0)
    assert other.assess(3.0, 0.9, rotation(0), 0.9) == (True, 0.5)
