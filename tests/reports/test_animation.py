from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from fitted import STEPS, fitted_mug
from PIL import Image

from kfit.reports.animation import LAST_SECONDS, RATE, SIDE, animate
from kfit.reports.fit_frames import fit_frames


def test_frames_are_the_winners_steps_and_the_answer_is_among_them() -> None:
    result = fitted_mug()
    frames = fit_frames(result)
    assert frames.drawings.shape == (STEPS + 1, 64, 64, 3)
    assert np.abs(frames.drawings[frames.answer] / 255 - result.drawing).max() < 0.003
    assert frames.energy[frames.answer] == pytest.approx(result.energy)
    assert set(frames.terms) == set(result.fit.history.terms)
    assert all(len(values) == STEPS + 1 for values in frames.terms.values())


def test_a_winner_that_came_to_rest_has_the_steps_until_then() -> None:
    result = fitted_mug()
    energy = result.fit.history.energy.clone()
    answer = fit_frames(result).answer
    energy[answer + 1 :] = torch.nan
    rested = replace(result, fit=replace(result.fit, history=replace(result.fit.history, energy=energy)))
    assert len(fit_frames(rested).drawings) == answer + 1


def test_a_gif_has_a_frame_for_each_step_and_the_crop_in_all(tmp_path: Path) -> None:
    place = animate(fitted_mug(), tmp_path / "new" / "fit.gif")
    with Image.open(place) as moving:
        assert moving.n_frames == STEPS + 1
        pictures = []
        for step in range(moving.n_frames):
            moving.seek(step)
            pictures.append(np.asarray(moving.convert("RGB"), np.int16))
    crops = [picture[:SIDE, :SIDE] for picture in pictures]
    observation = np.asarray(Image.fromarray(fit_frames(fitted_mug()).observed).resize((SIDE, SIDE)), np.int16)
    assert all(np.abs(crop - observation).mean() < 6 for crop in crops)
    drawings = [picture[:SIDE, -SIDE:] for picture in pictures]
    assert np.abs(drawings[0] - drawings[-1]).mean() > 1


def test_an_mp4_can_be_read_and_rests_at_its_end(tmp_path: Path) -> None:
    video = cv2.VideoCapture(str(animate(fitted_mug(), tmp_path / "fit.mp4")))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == STEPS + RATE * LAST_SECONDS
    there, picture = video.read()
    assert there
    assert picture.shape[1] > 2 * SIDE


def test_another_suffix_gets_one_sentence_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^animation must be a \.gif or \.mp4 file, got .*fit\.avi'$"):
        animate(fitted_mug(), tmp_path / "fit.avi")
    assert not list(tmp_path.iterdir())
