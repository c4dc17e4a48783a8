"""Photos with ground truth from NOCS's excerpt, where the folder is at hand."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from skimage.measure import ransac
from skimage.transform import SimilarityTransform

import kfit
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
