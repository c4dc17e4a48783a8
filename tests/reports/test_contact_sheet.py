import math

import numpy as np
import pytest
import torch

from kfit.geometry import Crop
from kfit.reports.contact_sheet import PANEL, SheetEntry, contact_sheet, evenly


def entry(image, mask, distance=2.0):
    camera = torch.tensor([[100.0, 0, 39.5], [0, 100.0, 29.5], [0, 0, 1]])
    place, size = torch.tensor([0.0, 0.0, distance]), torch.tensor([0.3, 0.3, 0.3])
    crop = Crop((39.5, 29.5), 30.0)
    return SheetEntry(image, mask, crop, np.zeros((64, 64, 3)), torch.eye(3), place, size, camera, "1.0°, 2.0 cm")


@pytest.fixture
def view():
    image, mask = np.zeros((60, 80, 3)), np.zeros((60, 80))
    image[..., 1] = 1.0
    mask[20:40, 30:50] = 1
    image[mask > 0] = (1.0, 0.0, 0.0)
    return image, mask


def test_errors_are_shown_evenly_from_the_least_to_the_greatest():
    errors = [5.0, math.nan, 1.0, 3.0, 2.0, 4.0]
    assert evenly(errors, 3) == [2, 3, 0]
    assert evenly(errors, 9) == [2, 4, 3, 5, 0]
    assert evenly(errors, 1) == [2]
    assert evenly([math.nan], 3) == []


def test_a_cell_shows_photo_mask_drawing_and_pose(view):
    sheet = contact_sheet([entry(*view)], "title")
    height, width, _ = sheet.shape
    assert width > 4 * PANEL
    row = height - 60 - PANEL // 2
    photo, mask, drawing, pose = (sheet[row, 14 + k * (PANEL + 2) :][:PANEL] for k in range(4))
    middle, edge = PANEL // 2, 8
    assert photo[middle].tolist() == mask[middle].tolist() == [255, 0, 0]
    assert photo[edge].tolist() == [0, 255, 0]
    assert mask[edge].max() < 120
    assert drawing[middle].tolist() == [0, 0, 0]
    assert pose[edge].tolist() == [0, 255, 0]
    assert (pose[:, 2] > 100).any()  # the axis z ends in a blue disc, seen end on


def test_cells_fill_columns_from_the_top(view):
    one, three = (contact_sheet([entry(*view)] * count, "title") for count in (1, 3))
    assert three.shape[1] > 1.9 * one.shape[1]
    lower = three[one.shape[0] :]
    assert lower[:, : one.shape[1] - 14].std() > 10
    assert (lower[:, one.shape[1] :] == 255).all()


def test_a_pose_behind_the_camera_does_not_spoil_the_sheet(view):
    assert contact_sheet([entry(*view, distance=0.01)], "title").shape[0] > PANEL


def test_nothing_to_show_is_an_error():
    with pytest.raises(ValueError, match="at least one fit, got none"):
        contact_sheet([], "title")
