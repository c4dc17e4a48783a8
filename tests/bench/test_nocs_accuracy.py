from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nocs_lookalike import write_frames

from kfit.bench.nocs_accuracy import KnownObject, fit_known, known_objects
from kfit.generators import RadianceField
from kfit.pose import CategoryModel


@pytest.fixture
def known(tmp_path: Path) -> KnownObject:
    write_frames(tmp_path, [["mug", "laptop"]])
    return next(known_objects(tmp_path, ["mug"]))


def posed(known: KnownObject, rotation: np.ndarray, translation: np.ndarray) -> KnownObject:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = 0.2 * rotation, translation
    return replace(known, thing=replace(known.thing, pose=pose))


def test_objects_of_the_categories_are_found_with_the_part_of_the_data_they_are_of(tmp_path: Path) -> None:
    write_frames(tmp_path, [["mug", "laptop"], ["can", "mug"]])
    names = [known.name for known in known_objects(tmp_path, ["mug", "bowl"])]
    assert names == ["real_test scene_1/0000 1", "real_test scene_2/0001 2"]
    with pytest.raises(FileNotFoundError, match="holds none of camera_train"):
        list(known_objects(tmp_path / "real", ["mug"]))


def test_errors_are_measured_from_the_true_pose(tiny_model: CategoryModel, known: KnownObject) -> None:
    pipeline = tiny_model.pipeline(2, 1)
    fit = fit_known(tiny_model, known, pipeline, depth=False)
    assert fit is not None
    answer = fit[0]
    right = fit_known(tiny_model, posed(known, answer.rotation, answer.translation), pipeline, depth=False)
    assert right is not None
    assert right[1:] == pytest.approx((0, 0), abs=1e-3)
    # Turned by 90° about its own axis, and 3 cm further: of a mug whose handle is hidden the axis alone counts.
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    wrong = posed(known, answer.rotation @ turn, answer.translation + np.array([0, 0, 0.03]))
    fit = fit_known(tiny_model, wrong, pipeline, depth=False)
    assert fit is not None
    assert fit[1:] == pytest.approx((90, 3), abs=1e-3)
    hidden = replace(wrong, thing=replace(wrong.thing, handle_visible=False))
    fit = fit_known(tiny_model, hidden, pipeline, depth=False)
    assert fit is not None
    assert fit[1] == pytest.approx(0, abs=1e-3)


def test_an_object_without_depth_is_not_fitted_to_it(tiny_model: CategoryModel, known: KnownObject) -> None:
    blind = replace(known, frame=replace(known.frame, depth=np.zeros_like(known.frame.depth)))
    assert fit_known(tiny_model, blind, tiny_model.pipeline(2, 1), depth=True) is None
    nowhere = replace(known, thing=replace(known.thing, pose=None))
    with pytest.raises(ValueError, match="has no known pose"):
        fit_known(tiny_model, nowhere, tiny_model.pipeline(2, 1), depth=False)


def test_a_model_knows_whether_it_draws_depth(tiny_model: CategoryModel) -> None:
    assert "depth" not in tiny_model.drawn
    deep = CategoryModel(
        RadianceField(code_dim=4, volume_dims=[8, 4], num_samples=4),
        tiny_model.encoder,
        tiny_model.extents,
        tiny_model.card,
    )
    assert "depth" in deep.drawn
