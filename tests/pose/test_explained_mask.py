"""A found mask that the drawing explains poorly is tried without the parts that stick out of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from skimage.data import coffee

import kfit
from kfit.geometry import rotation_error
from kfit.models.find_poses import pose_of
from kfit.pose.object_finder import FoundObject, box_of
from kfit.segmentation import Photo, Segment, mask_from_file

PHOTO = Photo(np.zeros((100, 120, 3), np.float32))


def with_bar() -> np.ndarray:
    mask = np.zeros(PHOTO.image.shape[:2], np.float32)
    mask[30:70, 20:60] = 1
    mask[45:55, 60:100] = 1
    return mask


@dataclass(frozen=True)
class Answer:
    energy: float
    confidence: float = 0.9
    calibrated: bool = True
    notes: list[str] = field(default_factory=list)
    category_score: float | None = None


class Model:
    """Explains masks of at most 100 columns with the given energies: of the whole mask, and without the bar."""

    def __init__(self, whole: float, without: float) -> None:
        self.energies, self.calls = {True: whole, False: without}, []
        self.card = SimpleNamespace(calibration={"RGB": SimpleNamespace(explains=lambda energy: energy <= 1.0)})

    def pose(self, photo: Photo, *, segmenter: FoundObject, callbacks: Any, **given: Any) -> Answer:
        has_bar = bool(segmenter.segment.mask[50, 90])
        self.calls.append((has_bar, len(callbacks)))
        return Answer(self.energies[has_bar])


def pose(model: Any, given: bool = False) -> Any:
    mask = with_bar()
    target = FoundObject("mug", 0.95, box_of(mask), Segment(mask), given)
    return pose_of(model, PHOTO, target, callbacks=[object()])  # type: ignore[list-item]


def test_an_unexplained_mask_is_tried_without_its_bar_unwatched() -> None:
    model = Model(whole=2.0, without=0.5)
    assert pose(model).energy == 0.5
    assert model.calls == [(True, 1), (False, 0)]


@pytest.mark.parametrize(("whole", "without"), [(2.0, 1.5), (0.9, 0.5)])
def test_the_whole_mask_stays_where_it_is_explained_or_its_rest_is_not(whole: float, without: float) -> None:
    assert pose(Model(whole, without)).energy == whole


def test_a_given_mask_is_never_changed() -> None:
    model = Model(whole=2.0, without=0.5)
    assert pose(model, given=True).energy == 2.0
    assert model.calls == [(True, 1)]


@pytest.mark.slow
def test_the_handle_of_the_coffee_cup_is_not_taken_for_the_spoon_next_to_it() -> None:
    photo = coffee()
    [cup] = kfit.find_poses(photo)
    by_hand = kfit.load("mug").pose(photo, mask=mask_from_file("examples/coffee_mask.png", photo.shape[:2]))
    apart = rotation_error(torch.from_numpy(cup.rotation), torch.from_numpy(by_hand.rotation)).rad2deg()
    assert float(apart) < 20
