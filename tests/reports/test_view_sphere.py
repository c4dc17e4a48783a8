from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted import fitted_mug

from kfit.geometry import Crop, intrinsics_from_fov, pose_from_crop
from kfit.pose import Alternative
from kfit.reports.view_sphere import view_sphere
from kfit.reports.words import camera_angles


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (-113, 53), (170, -10), (40, 85)])
def test_the_camera_is_where_the_fit_saw_the_object_from(azimuth: float, elevation: float) -> None:
    angles = torch.tensor([[azimuth], [elevation], [12.0]]).double().deg2rad()
    shift, scale = torch.tensor([[0.1, -0.2]]).double(), torch.ones(1).double()
    camera = intrinsics_from_fov(640, 480).double()
    rotation, translation = pose_from_crop(*angles, shift, scale, Crop((550, 400), 120), camera, 0.2)
    found = camera_angles(rotation[0].numpy(), translation[0].numpy())
    assert found == pytest.approx((azimuth, elevation, 12), abs=1e-6)


def rotated(degrees: float, weight: float) -> Alternative:
    """The fitted mug turned about its own upright axis."""
    a = math.radians(degrees)
    about = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    return Alternative(fitted_mug().rotation @ about, 1.0, weight, 2.0)


def discs(svg: str) -> list[float]:
    """Areas of the discs, in the order in which they are drawn; a disc is eight curves about 0."""
    found = re.findall(r"<path d=\"M 0 ([\d.]+) \nC ", svg) + re.findall(r"d=\"M 0 ([\d.]+)\s+C", svg)
    return [math.pi * float(radius) ** 2 for radius in dict.fromkeys(found)]


def test_discs_have_the_poses_weights_and_the_answer_is_marked() -> None:
    svg = view_sphere(replace(fitted_mug(), alternatives=[rotated(0, 0.7), rotated(90, 0.2), rotated(180, 0.1)]))
    assert re.findall(r">([^<>]*\d+ %)<", svg) == ["10 %", "20 %", "answer, 70 %"]
    tenth, fifth, answer = sorted(discs(svg))
    assert (answer - fifth) / (fifth - tenth) == pytest.approx(5, rel=0.01)
    assert ", 70 % of the weight" in svg


def test_an_object_that_may_turn_has_circles_of_views() -> None:
    mug = fitted_mug()
    plain, symmetric = view_sphere(mug), view_sphere(replace(mug, category="bowl", symmetry="y"))
    assert symmetric.count("<path") - plain.count("<path") == 90 * len(mug.alternatives)
