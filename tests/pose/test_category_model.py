from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import kfit
from kfit.bench.held_out_views import (
    called_ambiguous,
    handle_share,
    held_out_views,
    rotation_errors,
    translation_errors,
)
from kfit.core import FitResult, History
from kfit.data import build, pose_view, render
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.optimizers import Adam
from kfit.pose import CategoryModel

INTRINSICS = np.array([[500.0, 0, 159.5], [0, 500.0, 119.5], [0, 0, 1]])


def photo_of(category: str, seed: int) -> tuple[np.ndarray, np.ndarray, torch.Tensor, torch.Tensor]:
    """An object 0.9 m away and off the middle: picture, mask, and its true rotation and translation (OpenCV axes)."""
    mesh, light = build(category, seed)
    azimuth, elevation = math.radians(30), math.radians(35)
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    turn = np.array([[1, 0, 0], [0, ce, -se], [0, se, ce]]) @ np.array([[ca, 0, sa], [0, 1, 0], [-sa, 0, ca]])
    diagonal = kfit.load(category).card.mean_diagonal
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * diagonal, (0.12, 0.06, -0.9)
    view = render(mesh, pose, INTRINSICS, (240, 320), light)
    flip = np.diag([1.0, -1.0, -1.0])
    return view.image, view.mask > 0.5, torch.from_numpy(flip @ turn), torch.from_numpy(flip @ pose[:3, 3])


@pytest.mark.parametrize("category", ["mug", pytest.param("laptop", marks=pytest.mark.slow)])
def test_a_bundled_model_finds_pose_and_place_of_a_drawn_object(category: str) -> None:
    image, mask, rotation, translation = photo_of(category, 5)
    result = kfit.load(category).pose(image, mask=mask, intrinsics=INTRINSICS)
    assert math.degrees(rotation_error(torch.from_numpy(result.rotation), rotation)) < 12
    assert np.linalg.norm(result.translation - translation.numpy()) < 0.1
    assert result.intrinsics_from == "given"
    # The laptop reaches beyond the photo's right border, the mug does not; both are fitted as their cards say.
    border = [note for note in result.notes if "the mask touches the picture's border (right)" in note]
    assert len(border) == (category == "laptop")
    assert result.fit.num_evaluations == 16 + 4 * 4 + 2 * 13


@pytest.mark.slow
def test_depth_fixes_distance_and_size_of_an_object_larger_than_its_kind() -> None:
    mesh, light = build("laptop", 1_000_002, held_out=True)
    diagonal = 1.3 * kfit.load("laptop").card.mean_diagonal
    pose = np.eye(4)
    turn = rotation_from_angles(torch.tensor(0.5), torch.tensor(0.6), torch.tensor(0.0)).numpy()
    pose[:3, :3], pose[:3, 3] = turn * diagonal, (0.12, 0.06, -0.9)
    view = render(mesh, pose, INTRINSICS, (240, 320), light)
    model, mask = kfit.load("laptop"), view.mask > 0.5
    depth = np.where(mask, view.depth, 3.0)
    depth[100:110] = np.nan  # the camera has not seen all of it
    found = model.pose(view.image, mask=mask, intrinsics=INTRINSICS, depth=depth)
    assert found.size_from == "depth"
    assert np.linalg.norm(found.translation - np.array([0.12, -0.06, 0.9])) < 0.04
    assert found.translation[2] == pytest.approx(0.9, abs=0.02)
    assert np.linalg.norm(found.size) == pytest.approx(diagonal, rel=0.15)
    colour = model.pose(view.image, mask=mask, intrinsics=INTRINSICS)
    assert colour.size_from == "mean size"
    assert np.linalg.norm(colour.translation - np.array([0.12, -0.06, 0.9])) > 0.1


def test_depth_that_does_not_fit_is_an_error(tiny_model: CategoryModel) -> None:
    image, mask = np.ones((50, 60, 3), np.float32), np.zeros((50, 60), bool)
    mask[10:30, 20:50] = True
    with pytest.raises(ValueError, match=r"depth must have the photo's shape \(50, 60\), got \(60, 50\)"):
        tiny_model.pose(image, mask=mask, depth=np.ones((60, 50)))
    with pytest.raises(ValueError, match="depth is unknown everywhere on the object"):
        tiny_model.pose(image, mask=mask, depth=np.where(mask, 0.0, 1.0))
    with pytest.raises(ValueError, match="the generator draws no depth"):
        tiny_model.pose(image, mask=mask, depth=np.ones((50, 60)))


def test_the_result_is_json_with_the_promised_fields(tiny_model: CategoryModel) -> None:
    image, mask = np.ones((50, 60, 3), np.float32), np.zeros((50, 60), bool)
    mask[10:30, 20:50] = True
    saved = json.loads(json.dumps(tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(4, 2)).to_dict()))
    assert set(saved) >= {
        "category", "rotation", "quaternion_wxyz", "translation", "size", "size_from", "bbox_xywh", "energy",
        "confidence", "alternatives", "intrinsics", "intrinsics_assumed", "focal_length_px", "focal_log_sd",
    }  # fmt: skip
    assert saved["bbox_xywh"] == [20, 10, 30, 20]
    assert saved["intrinsics_assumed"] is True
    assert saved["intrinsics"][0][2] == 29.5
    assert saved["focal_length_px"] == pytest.approx(
        1.2 * 60
    )  # this generator draws from one distance, so nothing tells
    assert 0.2 < saved["focal_log_sd"] < 0.5
    assert "focal length estimated" in " ".join(saved["notes"])
    assert np.allclose(np.linalg.det(saved["rotation"]), 1)
    assert math.isclose(np.linalg.norm(saved["quaternion_wxyz"]), 1, rel_tol=1e-6)
    assert math.isclose(sum(a["weight"] for a in saved["alternatives"]), 1, rel_tol=1e-6)
    assert saved["confidence"] == saved["alternatives"][0]["weight"]
    assert np.allclose(saved["alternatives"][0]["rotation"], saved["rotation"], atol=1e-6)
    assert np.isclose(np.linalg.norm(saved["size"]), 0.17)


@pytest.mark.slow
def test_an_unknown_focal_length_is_fitted_and_a_given_one_held() -> None:
    mesh, light = build("mug", 1_000_004, held_out=True)
    view, model = pose_view(mesh, 0.4, 0.6, light, 96, distance=2.0, unit_fraction=0.6), kfit.load("mug")
    camera = np.array([[120.0, 0, 47.5], [0, 120.0, 47.5], [0, 0, 1]])
    inputs, free = (model.pose(view.image, view.mask, intrinsics=K) for K in (camera, None))
    assert (inputs.intrinsics_from, inputs.focal_log_sd) == ("given", 0.0)
    assert inputs.intrinsics == pytest.approx(camera)
    assert float(inputs.fit.values["focal"]) == pytest.approx(120 / inputs.crop.side)
    assert free.intrinsics_from == "estimated"
    assert free.intrinsics[0, 0] == pytest.approx(float(free.fit.values["focal"]) * free.crop.side)
    assert free.intrinsics[0, 0] != pytest.approx(1.2 * 96, rel=1e-3)
    assert "confidence not calibrated" not in " ".join(free.notes)


def test_more_poses_are_drawn_than_started_and_steps_grow_smaller(
    tiny_model: CategoryModel,
) -> None:
    pipeline = tiny_model.pipeline(3, 50)
    assert (pipeline.num_candidates, pipeline.num_starts) == (48, 3)
    headed = kfit.load("mug").pipeline()
    assert (headed.num_candidates, headed.num_starts, headed.num_steps) == (16, 4, 16)
    adam = pipeline.optimizer
    assert isinstance(adam, Adam)
    assert isinstance(adam.rates, dict)
    assert adam.rates["azimuth"] == 0.03  # the released code's
    assert adam.decay**50 == pytest.approx(0.08)
    assert tiny_model.pipeline(4, 0).num_steps == 0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer(tiny_model: CategoryModel) -> None:
    image, mask = np.random.default_rng(0).random((40, 40, 3)), np.ones((40, 40))
    first, again = (tiny_model.pose(image, mask=mask, seed=3, pipeline=tiny_model.pipeline(4, 2)) for _ in range(2))
    assert np.array_equal(first.rotation, again.rotation)
    assert first.energy == again.energy


IMAGE = np.zeros((20, 30, 3), np.uint8)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"image": np.zeros((20, 30))}, r"image must have shape \(H, W, 3\), got \(20, 30\)"),
        ({"image": np.zeros((20, 30, 3), np.int64)}, "image must be uint8 or floating point"),
        ({"image": np.full((20, 30, 3), 200.0)}, r"image must lie in \[0, 1\], got numbers from 200 to 200"),
        ({"image": np.full((20, 30, 3), np.nan)}, r"image must lie in \[0, 1\]"),
        ({"image": IMAGE, "mask": np.zeros((20, 30))}, "mask is empty"),
        ({"image": IMAGE, "mask": np.ones((20, 31))}, r"mask must have the photo's shape \(20, 30\), got \(20, 31\)"),
        ({"image": IMAGE, "mask": np.ones((20, 30)), "box": (0, 0, 9, 9)}, "mask and box were both given"),
        ({"image": IMAGE, "box": (40, 0, 9, 9)}, "outside the picture"),
        ({"image": IMAGE, "mask": np.ones((20, 30)), "intrinsics": np.eye(2)}, r"intrinsics must be \(3, 3\)"),
        ({"image": IMAGE, "mask": np.ones((20, 30)), "intrinsics": np.zeros((3, 3))}, "focal lengths above 0"),
        (
            {"image": IMAGE, "mask": np.ones((20, 30)), "intrinsics": np.diag([1e-9, 1e-9, 1])},
            "intrinsics of a photo of 30 x 20 must have focal lengths from 3 to 30000 pixels, got 1e-09 and 1e-09",
        ),
        (
            {"image": IMAGE, "mask": np.ones((20, 30)), "intrinsics": np.diag([30.0, 1e6, 1])},
            "intrinsics of .* from 3 to 30000 pixels, got 30 and 1e",
        ),
    ],
)
def test_a_wrong_argument_gets_a_sentence(tiny_model: CategoryModel, arguments: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        tiny_model.pose(**arguments)


@pytest.mark.parametrize(("x", "doubted"), [(15.0, False), (13.0, False), (29.5, True), (40.0, True), (-3.0, True)])
def test_a_principal_point_far_from_the_photos_middle_is_noted(
    tiny_model: CategoryModel, x: float, doubted: bool
) -> None:
    camera = np.array([[30.0, 0, x], [0, 30.0, 10.0], [0, 0, 1]])
    answer = tiny_model.pose(IMAGE, np.ones((20, 30)), intrinsics=camera, pipeline=tiny_model.pipeline(1, 0))
    assert any("far from the photo's middle" in note for note in answer.notes) == doubted


@pytest.mark.slow
def test_unseen_views_know_whether_a_handle_shows() -> None:
    model = kfit.load("mug")
    views = held_out_views(model, 12, photo_size=64)
    assert views.observation.image.shape == (12, 3, 64, 64)
    assert 0 < int(views.visible.sum()) <= 12


def test_the_handle_share_is_zero_from_behind_and_large_from_the_side() -> None:
    from kfit.data import pose_view

    mesh, light = build("mug", 3)
    shares = [handle_share(pose_view(mesh, 0.2, math.radians(a), light), mesh.extents) for a in (0, 90)]
    assert shares[0] > 0.05
    assert shares[1] < 0.02  # azimuth 90° turns +x away from the viewer


@pytest.mark.slow
def test_errors_do_not_depend_on_the_batch(tiny_model: CategoryModel) -> None:
    views = held_out_views(tiny_model, 3, photo_size=64)
    pipeline = tiny_model.pipeline(3, 2)
    together, _ = rotation_errors(tiny_model, views, pipeline, batch_size=3)
    alone, _ = rotation_errors(tiny_model, views, pipeline, batch_size=1)
    assert torch.allclose(together, alone, atol=0.5)


def test_translations_are_measured_from_where_the_objects_were_drawn(tiny_model: CategoryModel) -> None:
    views = held_out_views(tiny_model, 2, photo_size=64)
    middle = torch.tensor([31.5, 31.5])
    shift = torch.stack([(middle - torch.tensor(crop.centre)) / (crop.side / 2) for crop in views.crops])
    angles = {name: torch.zeros(2) for name in ("azimuth", "elevation", "roll")}
    values = {**angles, "shift": shift * torch.tensor([1.0, -1.0]), "scale": torch.ones(2)}
    rows = torch.arange(2)
    fit = FitResult(
        {**values, "distance": views.translation[:, 2].float()}, torch.zeros(2), 0 * rows, rows, 0 * rows,
        torch.zeros(2), {**values}, History(torch.zeros(1, 2, 1), {}, {}),
    )  # fmt: skip
    assert translation_errors(tiny_model, views, [fit]).max() < 1e-4
    nearer = replace(fit, values={**fit.values, "distance": views.translation[:, 2].float() - 0.1})
    torch.testing.assert_close(
        translation_errors(tiny_model, views, [nearer]).float(), torch.full((2,), 0.1), rtol=1e-3, atol=0
    )
    assert called_ambiguous(tiny_model, views, [fit]).tolist() == [False, False]


def test_depth_of_unseen_views_is_metric_and_known_on_the_object_alone(tiny_model: CategoryModel) -> None:
    views = held_out_views(tiny_model, 2, photo_size=64)
    depth, mask = views.observation.field("depth"), views.observation.field("mask")
    known = depth.isfinite()
    assert not known[mask < 0.2].any()
    assert known[mask > 0.9].all()
    middle = depth.flatten(1).nanmedian(1).values
    assert ((middle - views.translation[:, 2]).abs() < tiny_model.card.mean_diagonal).all()


def test_a_path_and_an_array_give_the_same_answer(tiny_model: CategoryModel, tmp_path: Path) -> None:
    from skimage.io import imsave

    pixels = np.random.default_rng(0).integers(0, 255, (40, 50, 3), np.uint8)
    imsave(tmp_path / "x.png", pixels, check_contrast=False)
    mask = np.ones((40, 50))
    answers = [
        tiny_model.pose(image, mask=mask, pipeline=tiny_model.pipeline(3, 1)) for image in (tmp_path / "x.png", pixels)
    ]
    assert np.allclose(answers[0].rotation, answers[1].rotation)
