"""Symmetries of objects, and categories as data."""

import math

import pytest
import torch

from kfit.core import Observation
from kfit.generators import RotationHead
from kfit.geometry import CATEGORIES, Category, rotation_error, rotation_from_angles, turns_about_y
from kfit.geometry.pose_network import PoseNetwork
from kfit.initializers import PosePosterior
from kfit.pose.covariance import rotation_offset


def rotation(azimuth, elevation=0.3, roll=0.2):
    return rotation_from_angles(*(torch.tensor([angle], dtype=torch.float64) for angle in (azimuth, elevation, roll)))


@pytest.mark.parametrize("fold", [2, 3, 4, 12])
def test_turns_of_a_symmetric_object_are_no_error_and_others_are(fold):
    rotated = rotation(0.7) @ turns_about_y(fold)
    assert rotation_error(rotation(0.7), rotated, f"y{fold}").max() < 1e-7
    half = math.pi / fold
    assert rotation_error(rotation(0.7), rotation(0.7 + half), f"y{fold}").item() == pytest.approx(half)
    assert rotation_error(rotation(0.7), rotation(0.7 + half)).item() == pytest.approx(half)


def test_a_rotation_vector_leads_to_the_nearest_pose_of_the_same_look():
    rotated = rotation(0.7 + math.pi + 0.1)
    assert rotation_offset(rotated, rotation(0.7), "y2").norm().item() == pytest.approx(0.1)
    assert rotation_offset(rotated, rotation(0.7), "none").norm().item() == pytest.approx(math.pi - 0.1)


@pytest.mark.parametrize("fold", [2, 4])
def test_a_head_of_a_symmetric_object_has_bins_for_a_part_of_the_circle(fold):
    head = RotationHead(f"y{fold}", channels=(8, 8), hidden_dim=8, bin_deg=30.0, image_size=16)
    assert head.num_azimuths == 12 // fold
    angles = [torch.tensor([angle, angle + 2 * math.pi / fold]) for angle in (0.4,)]
    kernel = head.log_kernel(angles[0], torch.full((2,), 0.3), torch.full((2,), 0.2))
    torch.testing.assert_close(kernel[0], kernel[1], atol=1e-4, rtol=1e-4)


class KnowingHead(PoseNetwork):
    """Says the target of one rotation, whatever it sees."""

    def __init__(self, symmetry, azimuth):
        bins = RotationHead(symmetry, channels=(8, 8), hidden_dim=8, image_size=16)
        super().__init__(torch.zeros(1), torch.zeros(1), torch.zeros(1), symmetry, bins.sigma)
        self.rotations, self.log_volume = bins.rotations, bins.log_volume
        self.weight = torch.nn.Parameter(torch.zeros(1))  # by which predictions are told apart
        self.num_rolls, self.truth = bins.num_rolls, azimuth

    def forward(self, image):
        angles = torch.tensor([self.truth]), torch.tensor([0.3]), torch.tensor([0.2])
        return self.log_kernel(*angles).expand(len(image), -1)


@pytest.mark.parametrize("azimuth", [0.0, math.pi / 4, math.pi / 2, 3.0])
def test_starts_lie_at_the_mean_of_bins_on_both_sides_of_a_symmetry_s_seam(azimuth):
    start = PosePosterior(KnowingHead("y2", azimuth))({}, Observation(torch.zeros(1, 3, 16, 16)), 1, [])
    found = rotation_from_angles(*(start[name].double() for name in ("azimuth", "elevation", "roll")))
    assert math.degrees(rotation_error(found, rotation(azimuth), "y2")) < 2


def test_a_category_is_plain_data_and_reads_back():
    table = Category("table", 1.4, "y2", diagonals=(0.8, 2.5), mirror=False)
    assert Category.of_dict(table.to_dict()) == table
    assert table.azimuth_deg == (-90.0, 90.0)
    assert Category("vase", 0.3).size_range == pytest.approx((0.1, 0.9))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"name": "te apot", "mean_diagonal": 1.0}, "name must be a word"),
        ({"name": "a", "mean_diagonal": 0.0}, "mean_diagonal must lie between"),
        ({"name": "a", "mean_diagonal": 1.0, "symmetry": "z"}, "symmetry must be one of none, y, y2"),
        ({"name": "a", "mean_diagonal": 1.0, "sides": [1, 2, 3]}, "sides must lie between"),
        ({"name": "a"}, "nothing for mean_diagonal"),
        ({"name": "a", "mean_diagonal": 1.0, "size": 3}, "unknown size; the names are axes"),
    ],
)
def test_a_category_that_cannot_be_gets_a_sentence(values, message):
    with pytest.raises(ValueError, match=message):
        Category.of_dict(values)


def test_kfit_s_own_categories_are_those_of_nocs():
    assert [(c.name, c.nocs_id, c.shapes) for c in CATEGORIES.values()] == [
        (name, number, f"kfit.data.shapes.{name}")
        for number, name in enumerate(("bottle", "bowl", "camera", "can", "laptop", "mug"), 1)
    ]
