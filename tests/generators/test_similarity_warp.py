"""The similarity warp against OpenCV, known spots, and the camera's conventions."""

import math

import cv2
import numpy as np
import pytest
import torch

from kfit.core import Angle, Generator, Positive, Rendering, Variable
from kfit.generators import SimilarityWarp, fixed_camera
from kfit.generators.similarity_warp import warp
from kfit.geometry import Crop, pose_from_crop

SIZE = 64


def spot(u=0.0, v=0.0, wide=3.0, size=(SIZE, SIZE)):
    """A black spot on white at (u, v) in half-sides from the centre, v up, with mask and depth."""
    height, width = size
    rows, columns = torch.meshgrid(*[torch.arange(n, dtype=torch.float64) for n in size], indexing="ij")
    x, y = (width - 1) / 2 + u * width / 2, (height - 1) / 2 - v * height / 2
    mask = torch.exp(-((columns - x).square() + (rows - y).square()) / (2 * wide**2))[None, None]
    return Rendering((1 - mask).expand(1, 3, *size), mask, 0.2 + 0 * mask)


def warped(drawn, roll_deg=0.0, shift=(0.0, 0.0), scale=1.0):
    return warp(
        drawn,
        torch.tensor([math.radians(roll_deg)], dtype=torch.float64),
        torch.tensor([shift], dtype=torch.float64),
        torch.tensor([scale], dtype=torch.float64),
    )


def moments(drawn):
    """Centre in half-sides from the middle (right, up) and root of the area of the mask, in pixels."""
    mask = drawn.mask[0, 0]
    height, width = mask.shape
    rows, columns = torch.meshgrid(*[torch.arange(n, dtype=torch.float64) for n in mask.shape], indexing="ij")
    share = mask / mask.sum()
    x, y = float((share * columns).sum()), float((share * rows).sum())
    middle = ((width - 1) / 2, (height - 1) / 2)
    return (x - middle[0]) / (width / 2), (middle[1] - y) / (height / 2), float(mask.sum().sqrt())


def test_no_turn_shift_or_scale_gives_the_picture_itself():
    drawn = Rendering(*(0.1 + torch.rand(2, channels, 32, 32) for channels in (3, 1, 1)))
    same = warp(drawn, torch.zeros(2), torch.zeros(2, 2), torch.ones(2))
    torch.testing.assert_close(same.image, drawn.image, rtol=0, atol=2e-5)
    torch.testing.assert_close(same.mask, drawn.mask, rtol=0, atol=2e-5)
    torch.testing.assert_close(same.depth, drawn.depth, rtol=1e-3, atol=0)


class TestSigns:
    def test_scale_two_doubles_sizes_and_distances_from_the_middle(self):
        _, _, size = moments(spot())
        u, v, doubled = moments(warped(spot(0.2, -0.1), scale=2.0))
        assert (u, v) == pytest.approx((0.4, -0.2), abs=1e-3)
        assert doubled == pytest.approx(2 * size, rel=1e-3)

    def test_a_shift_of_half_moves_right_by_a_quarter_of_the_width(self):
        moved = warped(spot(), shift=(0.5, 0.0))
        assert moments(moved)[:2] == pytest.approx((0.5, 0.0), abs=1e-3)
        # By whole pixels the picture is the same, 16 of 64 further on.
        torch.testing.assert_close(moved.image[..., 16:], spot().image[..., :-16], rtol=0, atol=1e-9)

    def test_a_shift_along_y_is_up(self):
        moved = warped(spot(), shift=(0.0, 0.5))
        assert moments(moved)[:2] == pytest.approx((0.0, 0.5), abs=1e-3)
        torch.testing.assert_close(moved.image[..., :-16, :], spot().image[..., 16:, :], rtol=0, atol=1e-9)

    def test_a_quarter_turn_is_anticlockwise(self):
        moved = warped(spot(0.5, 0.0), roll_deg=90)
        assert moments(moved)[:2] == pytest.approx((0.0, 0.5), abs=1e-3)
        torch.testing.assert_close(moved.image, torch.rot90(spot(0.5, 0.0).image, 1, (2, 3)), rtol=0, atol=1e-9)

    def test_turns_and_scales_about_the_middle_and_then_shifts(self):
        u, v, _ = moments(warped(spot(0.3, 0.1), roll_deg=90, shift=(0.2, -0.1), scale=1.5))
        assert (u, v) == pytest.approx((0.2 - 1.5 * 0.1, -0.1 + 1.5 * 0.3), abs=1e-3)

    def test_shifts_an_oblong_picture_by_half_of_each_side(self):
        drawn = spot(wide=2.0, size=(32, 64))
        assert moments(warped(drawn, shift=(0.25, 0.5)))[:2] == pytest.approx((0.25, 0.5), abs=2e-3)


class TestOutside:
    def test_is_white_and_empty(self):
        black = Rendering(
            *(torch.full((1, channels, 16, 16), fill) for channels, fill in ((3, 0.0), (1, 1.0), (1, 0.5)))
        )
        moved = warp(black, torch.zeros(1), torch.tensor([[1.0, 0.0]]), torch.ones(1))
        assert moved.image[..., :8].tolist() == torch.ones(1, 3, 16, 8).tolist()
        assert not moved.mask[..., :8].any()
        assert not moved.depth[..., :8].any()
        torch.testing.assert_close(moved.image[..., 8:], torch.zeros(1, 3, 16, 8))
        torch.testing.assert_close(moved.depth[..., 8:], torch.full((1, 1, 16, 8), 0.5))

    def test_does_not_bleed_into_the_object_s_depth(self):
        mask = torch.zeros(1, 1, 16, 16)
        mask[..., 4:12, 4:12] = 1
        drawn = Rendering(1 - mask.expand(1, 3, 16, 16), mask, torch.where(mask > 0, 0.3, 9.0))
        moved = warp(drawn, torch.tensor([0.4]), torch.tensor([[0.03, 0.01]]), torch.tensor([1.1]))
        # Premultiplied: where the mask fades, the depth is still that of the object.
        edge = (moved.mask > 0.05) & (moved.mask < 0.95)
        assert int(edge.sum()) > 10
        torch.testing.assert_close(moved.depth[edge], torch.full_like(moved.depth[edge], 0.3), rtol=1e-4, atol=0)


def test_what_the_generator_does_not_draw_is_not_warped():
    image = spot().image
    assert warped(Rendering(image)).mask is None
    masked = warped(Rendering(image, spot().mask))
    assert masked.depth is None
    assert masked.mask is not None


@pytest.mark.parametrize(
    ("roll_deg", "shift", "scale"), [(20, (0.0, 0.0), 1.0), (-35, (0.3, -0.2), 0.8), (170, (-0.1, 0.25), 1.4)]
)
def test_draws_what_opencv_draws(roll_deg, shift, scale):
    rows, columns = np.mgrid[:SIZE, :SIZE]
    image = 0.5 + 0.4 * np.stack([np.sin(columns / 9), np.cos(rows / 7), np.sin((rows + columns) / 11)], -1)
    # OpenCV's own matrix: anticlockwise in degrees about a pixel, scaled.
    middle = (SIZE - 1) / 2
    matrix = cv2.getRotationMatrix2D((middle, middle), roll_deg, scale)
    matrix[:, 2] += np.array([shift[0], -shift[1]]) * SIZE / 2
    expected = cv2.warpAffine(
        image, matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1, 1, 1)
    )
    found = warped(Rendering(torch.from_numpy(image).permute(2, 0, 1)[None]), roll_deg, shift, scale).image
    # OpenCV rounds positions to 1/32 pixel, which shows where the picture ends at white.
    inside = cv2.erode(cv2.warpAffine(np.ones((SIZE, SIZE)), matrix, (SIZE, SIZE), borderValue=0), np.ones((3, 3)))
    apart = np.abs(found[0].permute(1, 2, 0).numpy() - expected)
    assert apart[inside == 1].max() < 5e-3
    assert apart.max() < 0.05


@pytest.mark.parametrize(
    ("roll_deg", "shift", "scale"),
    [(0, (0.3, 0.0), 1.0), (0, (0.0, 0.3), 1.0), (40, (0.0, 0.0), 1.0), (25, (-0.2, 0.1), 1.2)],
)
def test_moves_the_picture_as_the_pose_read_from_it_moves_the_object(roll_deg, shift, scale):
    # A point of the object beside its centre, drawn straight on at scale 1, then warped; and the same point brought
    # into the photo by the pose, seen through so long a lens that there is no perspective left.
    point, fraction = torch.tensor([0.2, 0.1, 0.0], dtype=torch.float64), 0.9
    u, v, _ = moments(warped(spot(*(2 * fraction * point[:2]).tolist(), wide=2.0), roll_deg, shift, scale))

    crop = Crop((210.0, 160.0), 120.0, SIZE)
    focal = 1e7
    intrinsics = torch.tensor([[focal, 0, 200.0], [0, focal, 150.0], [0, 0, 1]], dtype=torch.float64)
    zero = torch.zeros(1, dtype=torch.float64)
    rotation, translation = pose_from_crop(
        zero, zero, zero + math.radians(roll_deg), torch.tensor([shift], dtype=torch.float64), zero + scale, crop,
        intrinsics, 1.0, fraction,
    )  # fmt: skip
    observed = intrinsics @ (rotation[0] @ point + translation[0])
    x, y = (observed[:2] / observed[2]).tolist()
    assert ((x - 210) / 60, (160 - y) / 60) == pytest.approx((u, v), abs=2e-3)


def test_gradients_are_those_of_finite_differences():
    drawn = spot(0.1, 0.2, size=(9, 12))
    inputs = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in ([0.3], [[0.13, -0.21]], [1.1])]
    assert torch.autograd.gradcheck(lambda *values: warp(drawn, *values).image, inputs)
    assert torch.autograd.gradcheck(lambda *values: warp(drawn, *values).mask, inputs)


class Counted(Generator):
    """How many pictures were asked for."""

    def __init__(self):
        super().__init__()
        self.variables = {"code": Variable((2,)), "azimuth": Variable((), Angle())}
        self.rows = []

    def forward(self, **values):
        self.rows.append(len(values["azimuth"]))
        grey = (values["code"].sum(1) + values["azimuth"])[:, None, None, None]
        return Rendering(grey.expand(-1, 3, 8, 8), grey.sigmoid().expand(-1, 1, 8, 8))


def test_without_gradients_what_differs_in_the_plane_alone_is_drawn_once():
    code = torch.tensor([[0.1, 0.2], [0.1, 0.2], [0.3, 0.0], [0.1, 0.2]])
    values = {
        "code": code,
        "azimuth": torch.tensor([0.5, 0.5, 0.5, 0.7]),
        "roll": torch.tensor([0.0, 0.1, 0.2, 0.3]),
        "shift": torch.zeros(4, 2),
        "scale": torch.ones(4),
    }
    warped = SimilarityWarp(Counted())
    with torch.no_grad():
        found = warped(**values)
    asked = warped(**values)
    assert warped.generator.rows == [3, 4]
    torch.testing.assert_close(found.image, asked.image)
    torch.testing.assert_close(found.mask, asked.mask)


class Zoomed(Generator):
    """Grey by the focal length."""

    def __init__(self):
        super().__init__()
        self.variables = {"focal": Variable((), Positive())}
        self.focal = torch.tensor(4.0)

    def forward(self, focal):
        return Rendering((focal / 10)[:, None, None, None].expand(-1, 3, 8, 8))


def test_what_is_enlarged_is_drawn_by_a_lens_as_much_shorter():
    plane = {"roll": torch.zeros(2), "shift": torch.zeros(2, 2), "scale": torch.tensor([1.0, 2.0])}
    drawn = SimilarityWarp(Zoomed())(focal=torch.tensor([6.0, 6.0]), **plane)
    torch.testing.assert_close(drawn.image[:, 0, 3, 3], torch.tensor([0.6, 0.3]))
    held = SimilarityWarp(Zoomed()).bind(focal=torch.tensor(6.0))(**plane)
    torch.testing.assert_close(held.image, drawn.image)


def test_a_fixed_camera_draws_all_scales_alike_and_leaves_what_has_none():
    plane = {"roll": torch.zeros(2), "shift": torch.zeros(2, 2), "scale": torch.tensor([1.0, 2.0])}
    fixed = SimilarityWarp(fixed_camera(Zoomed()))
    assert set(fixed.variables) == set(plane)
    torch.testing.assert_close(fixed(**plane).image[:, 0, 3, 3], torch.tensor([0.4, 0.4]))
    counted = Counted()
    assert fixed_camera(counted) is counted


def test_a_generator_all_of_whose_variables_are_held_is_warped():
    held = SimilarityWarp(Counted()).bind(code=torch.tensor([0.1, 0.2]), azimuth=torch.tensor(0.5))
    with torch.no_grad():
        drawn = held(roll=torch.tensor([0.0, 0.4]), shift=torch.zeros(2, 2), scale=torch.ones(2))
    assert drawn.image.shape == (2, 3, 8, 8)
