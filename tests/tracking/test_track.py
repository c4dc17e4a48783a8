"""Objects followed from frame to frame."""

import numpy as np
import pytest
import torch

from kfit.bench.held_out_clip import held_out_clip
from kfit.geometry import rotation_error
from kfit.models import load
from kfit.pose.category_model import CategoryModel
from kfit.tracking import Tracker, track

FRAMES = 4


@pytest.fixture(scope="module")
def laptop():
    return load("laptop")


@pytest.fixture(scope="module")
def clip(laptop):
    return held_out_clip(laptop, 1, FRAMES)


@pytest.fixture(scope="module")
def first(laptop, clip):
    """The answer to the first frame."""
    return laptop.pose(clip.frames[0], mask=clip.masks[0] > 0.5, intrinsics=clip.intrinsics)


@pytest.fixture
def known_first(laptop, first, monkeypatch):
    """The model, which answers at once."""
    monkeypatch.setattr(laptop, "pose", lambda *args, **named: first)
    return laptop


def errors(clip, answers):
    found = torch.from_numpy(np.stack([answer.rotation for answer in answers]))
    return rotation_error(found, clip.rotation[: len(answers)]).rad2deg()


@pytest.mark.parametrize("own", [pytest.param(False, marks=pytest.mark.slow), True], ids=["true masks", "own masks"])
def test_an_object_is_followed(laptop, clip, own):
    masks = [mask > 0.5 for mask in clip.masks]
    inputs = {"mask": masks[0]} if own else {"masks": masks}
    answers = list(track(laptop, clip.frames, intrinsics=clip.intrinsics, **inputs))
    assert [answer.anew for answer in answers] == [True, *[False] * (FRAMES - 1)]
    assert float(errors(clip, answers).max()) < 10
    assert min(answer.overlap for answer in answers) > 0.8
    for answer, truth in zip(answers, masks, strict=True):
        found = answer.mask > 0.5
        assert (found & truth).sum() / (found | truth).sum() > 0.85
    assert answers[-1].drawing.shape == (64, 64, 3)


def test_a_frame_draws_three_pictures_and_runs_the_head_once(laptop, clip, first, monkeypatch):
    tracker = Tracker(laptop, first)
    drawn = []
    forward = type(tracker.bound).forward

    def counted(self, **values):
        drawn.append(len(values["azimuth"]))
        return forward(self, **values)

    monkeypatch.setattr(type(tracker.bound), "forward", counted)
    head, runs = type(laptop.pose_head), []
    read = head.forward
    monkeypatch.setattr(head, "forward", lambda self, image: (runs.append(len(image)), read(self, image))[1])
    tracker(clip.frames[1], clip.masks[1] > 0.5)
    assert runs == [1]
    assert drawn == [2, 1]
    assert tracker.num_drawn == 3


@pytest.mark.slow
def test_an_object_that_is_lost_is_looked_for_anew(laptop, clip, first):
    tracker = Tracker(laptop, first)
    asked = []
    pose = laptop.pose
    tracker.model = type("Asked", (), {"__getattr__": lambda _, name: getattr(laptop, name)})()
    tracker.model.pose = lambda *args, **named: (asked.append(named["box"]), pose(*args, **named))[1]
    answer = tracker(np.random.default_rng(0).random(clip.frames[0].shape, np.float32))
    assert len(asked) == 1
    assert answer.overlap == 0.0  # nothing stands out in noise
    assert tracker(clip.frames[0]).overlap > 0.5  # there it is again


def test_a_model_without_a_head_is_refused(laptop, clip):
    headless = CategoryModel(laptop.generator, laptop.encoder, laptop.extents, laptop.card)
    headless.pose = lambda *args, **named: pytest.fail("fitted in vain")
    with pytest.raises(ValueError, match="no pose head"):
        list(track(headless, clip.frames[:1], mask=clip.masks[0] > 0.5, intrinsics=clip.intrinsics))


def test_frames_of_another_size_and_missing_masks_are_named(known_first, clip):
    masks = [mask > 0.5 for mask in clip.masks]
    with pytest.raises(ValueError, match="frame must be as large as the first"):
        list(track(known_first, [clip.frames[0], clip.frames[1][:100]], mask=masks[0], intrinsics=clip.intrinsics))
    with pytest.raises(ValueError, match="one for each frame"):
        list(track(known_first, clip.frames[:2], masks=masks[:1], intrinsics=clip.intrinsics))


def test_a_frame_whose_drawing_explains_nothing_is_not_called_found(laptop, clip, first):
    tracker = Tracker(laptop, first)
    assert tracker.last.found
    assert tracker.last.confidence > 0.5
    good = tracker(clip.frames[1], clip.masks[1] > 0.5)
    assert good.found
    assert good.confidence > 0.5
    bar = np.zeros_like(clip.masks[2])
    bar[100:106, 20:300] = 1  # no laptop looks like it
    wrong = tracker(clip.frames[2], bar)
    assert not wrong.found
    assert wrong.confidence <= 0.5
    gone = tracker(clip.frames[3], np.zeros_like(clip.masks[3]))
    assert not gone.found
    assert gone.confidence == 0
