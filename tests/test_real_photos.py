"""Photos with ground truth from NOCS's excerpt, where the folder is at hand."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from skimage.measure import ransac
from skimage.transform import SimilarityTransform

import kfit
from kfit.data import NOCSFrames
from kfit.geometry import CATEGORIES, rotation_error
from kfit.models import bundled

CAMERA = np.array([[591.0125, 0, 322.525], [0, 590.16775, 244.11084], [0, 0, 1]])
NAMES = {category.nocs_id: name for name, category in CATEGORIES.items()}


def true_pose(frame: Path, mask: np.ndarray) -> SimilarityTransform:
    """Object to camera by a similarity between NOCS coordinates and depth (NOCS stores z flipped)."""
    coords = cv2.imread(f"{frame}_coord.png")[..., 2::-1] / 255
    coords[..., 2] = 1 - coords[..., 2]
    depth = cv2.imread(f"{frame}_depth.png", cv2.IMREAD_UNCHANGED) / 1000
    rows, columns = np.nonzero(mask & (depth > 0))
    z = depth[rows, columns]
    pixels = np.stack([columns, rows, np.ones_like(rows)], 1)
    points = (pixels @ np.linalg.inv(CAMERA).T) * z[:, None]
    some = np.random.default_rng(0).permutation(len(z))[:1500]
    pairs = (coords[rows, columns][some] - 0.5, points[some])
    model, _ = ransac(pairs, SimilarityTransform, min_samples=5, residual_threshold=0.015, max_trials=200, rng=0)
    return model


@pytest.mark.slow
@pytest.mark.parametrize(("instance", "bar"), [(1, 30), (2, 25), (3, 25), (4, 25), (5, 25)])
def test_an_object_of_the_real_frame_is_found(dev_data: Path, instance: int, bar: float) -> None:
    frame = dev_data / "nocs_sample/real_train/scene_1/0000"
    line = next(text.split() for text in Path(f"{frame}_meta.txt").read_text().splitlines() if text[0] == str(instance))
    category = NAMES[int(line[1])]
    if category not in bundled():
        pytest.skip(f"no bundled model of {category}")
    mask = cv2.imread(f"{frame}_mask.png", cv2.IMREAD_UNCHANGED) == instance
    truth = true_pose(frame, mask)
    rotation = torch.from_numpy(truth.params[:3, :3] / truth.scale)
    found = kfit.load(category).pose(f"{frame}_color.png", mask=mask, intrinsics=CAMERA)
    error = rotation_error(torch.from_numpy(found.rotation), rotation, CATEGORIES[category].symmetry)
    assert math.degrees(error) < bar


def dirty_masks(mask: np.ndarray) -> dict[str, np.ndarray]:
    """A mask (H, W) as careless tools leave it."""
    rng, height, width = np.random.default_rng(0), *mask.shape
    stray, second = mask.copy(), mask.copy()
    # Where there is most room: the corner farthest from the object.
    rows, columns = np.nonzero(mask)
    row, column = (2 if rows.mean() > height / 2 else height - 3, 2 if columns.mean() > width / 2 else width - 3)
    stray[row, column] = True
    side = round(0.3 * math.sqrt(mask.sum()))  # a tenth of the object's area
    second[
        slice(0, side) if row == 2 else slice(height - side, height),
        slice(0, side) if column == 2 else slice(width - side, width),
    ] = True
    return {"a stray pixel": stray, "0.1 % speckle": mask ^ (rng.random(mask.shape) < 0.001), "a second part": second}


@pytest.mark.slow
@pytest.mark.parametrize(("split", "number"), [("real_train", 0), ("camera_val", 0)])
def test_specks_and_second_parts_of_a_mask_turn_no_answer_by_two_degrees(
    dev_data: Path, split: str, number: int
) -> None:
    frame = NOCSFrames(dev_data / "nocs_sample", split)[number]
    rotated = {}
    for one in frame.objects:
        model, symmetry = kfit.load(one.category), CATEGORIES[one.category].symmetry
        pose = partial(model.pose, frame.image, intrinsics=frame.intrinsics)
        clean = torch.from_numpy(pose(mask=one.mask).rotation)
        for name, mask in dirty_masks(one.mask).items():
            error = rotation_error(torch.from_numpy(pose(mask=mask).rotation), clean, symmetry)
            rotated[one.category, one.instance, name] = math.degrees(error)
    print(rotated)
    assert max(rotated.values()) < 2, rotated
