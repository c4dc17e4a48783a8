"""A fit tells of each step, then gives the answer that it gives unwatched."""

import threading

import numpy as np
import pytest

from kfit.app.watched import watched
from kfit.core import Callback, FitError
from kfit.models import load
from kfit.models.find_poses import pose_of
from kfit.pose import PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.segmentation import Photo, Segment


@pytest.fixture(scope="module")
def model():
    return load("mug")


@pytest.fixture
def target(drawn_mug):
    mask = (drawn_mug[..., 3] > 0).astype(np.float32)
    photo = Photo(drawn_mug[..., :3].astype(np.float32) / np.float32(255))
    return photo, FoundObject("mug", 0.3, (0, 0, 128, 128), Segment(mask, ("a note",), ("a doubt",)))


@pytest.mark.slow
def test_each_step_is_reported_once_and_the_answer_is_that_of_an_unwatched_fit(model, target):
    *steps, result = watched(model, *target)
    assert [drawn.step for drawn in steps] == list(range(17))
    assert {drawn.num_steps for drawn in steps} == {16}
    assert [drawn.num_starts for drawn in steps] == [4, 4, 4] + [2] * 14
    energies = [drawn.energy for drawn in steps]
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < energies[0]
    unwatched = pose_of(model, *target)
    assert isinstance(result, PoseResult)
    assert result.to_dict() == unwatched.to_dict()
    assert result.confidence <= 0.3
    assert {"a note", "a doubt"} <= set(result.notes)
    assert np.abs(steps[-1].drawing - result.drawing).max() < 1e-3
    assert np.abs(steps[0].drawing - result.drawing).max() > 0.05
    assert steps[-1].silhouette.max() > 0.9
    assert steps[0].crop.side == result.crop.side


def test_leaving_ends_the_fit(model, target):
    before = threading.active_count()
    news = watched(model, *target)
    assert next(news).step == 0
    news.close()
    assert threading.active_count() == before


def test_what_goes_wrong_in_the_fit_is_raised_where_it_is_watched(model, target, monkeypatch):
    class Broken(Callback):
        def on_step(self, state):
            raise FitError("every start failed")

    original = model.pipeline
    monkeypatch.setattr(model, "pipeline", lambda **settings: original(callbacks=[Broken()], **settings))
    with pytest.raises(FitError, match="every start failed"):
        list(watched(model, *target))
