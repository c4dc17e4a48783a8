"""Warps of a fixed picture, held against OpenCV's."""

import cv2
import numpy as np
import pytest
import torch
from scipy.ndimage import map_coordinates

from kfit.core import Generator, Observation, Rendering
from kfit.generators import SimilarityWarp, Template
from kfit.generators.motions import values_of

STILL = {
    "translation": {"shift": [0.0, 0.0]},
    "euclidean": {"roll": 0.0, "shift": [0.0, 0.0]},
    "similarity": {"roll": 0.0, "shift": [0.0, 0.0], "scale": 1.0},
    "affine": {"roll": 0.0, "shift": [0.0, 0.0], "scale": 1.0, "stretch": 1.0, "shear": 0.0},
    "homography": {"corners": [[0.0, 0.0]] * 4},
}
MOVED = {
    "translation": {"shift": [0.21, -0.13]},
    "euclidean": {"roll": 0.3, "shift": [0.2, -0.1]},
    "similarity": {"roll": 0.3, "shift": [0.2, -0.1], "scale": 0.8},
    "affine": {"roll": -0.2, "shift": [0.1, 0.1], "scale": 1.1, "stretch": 1.2, "shear": 0.15},
    "homography": {"corners": [[0.1, -0.2], [-0.05, 0.1], [0.2, 0.1], [0.0, -0.1]]},
}


def picture(height=20, width=30):
    """Smooth, with white nowhere."""
    v, u = torch.meshgrid(torch.linspace(0, 3, height).double(), torch.linspace(0, 4, width).double(), indexing="ij")
    return torch.stack([0.3 + 0.2 * (u + k * v).sin() for k in (0, 1, 2)])


def rows(values):
    return {name: torch.tensor([value], dtype=torch.float64) for name, value in values.items()}


@pytest.mark.parametrize("motion", STILL)
class TestAMotion:
    def test_that_does_not_move_leaves_the_picture_as_it_is(self, motion):
        drawn = Template(picture(), motion)(**rows(STILL[motion]))
        torch.testing.assert_close(drawn.image[0], picture(), rtol=0, atol=1e-12)
        assert drawn.mask.min() > 1 - 1e-12

    def test_is_what_opencv_draws_with_its_matrix(self, motion):
        template, values = Template(picture(), motion, fill=0.0), rows(MOVED[motion])
        matrix = template.matrix(**values)[0].numpy()
        pixels = picture().permute(1, 2, 0).numpy()
        theirs = cv2.warpPerspective(pixels, matrix, (30, 20), flags=cv2.INTER_LINEAR)
        drawn = template(**values)
        inside = cv2.erode((drawn.mask[0, 0].numpy() > 0.999).astype(np.uint8), np.ones((3, 3))) > 0
        assert inside.sum() > 200
        # OpenCV rounds coordinates to 1/32 of a pixel
        apart = np.abs(drawn.image[0].permute(1, 2, 0).numpy() - theirs)[inside]
        assert apart.max() < 5e-3

    def test_is_white_or_the_fill_outside_and_the_mask_says_where(self, motion):
        values = rows(MOVED[motion])
        drawn = Template(picture(), motion)(**values)
        outside = (drawn.mask == 0).expand_as(drawn.image)
        assert outside.any()
        assert (drawn.image[outside] == 1).all()
        filled = Template(picture(), motion, fill=0.25)(**values)
        assert (filled.image[outside] == 0.25).all()
        torch.testing.assert_close(filled.mask, drawn.mask)
        torch.testing.assert_close(drawn.weight, drawn.mask)

    def test_is_the_same_at_half_the_size(self, motion):
        values = rows(MOVED[motion])
        large, small = (Template(picture(size, size), motion).matrix(**values) for size in (40, 20))
        halve = torch.tensor([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]], dtype=torch.float64)
        expected = halve @ large @ halve.inverse()
        torch.testing.assert_close(small / small[:, 2:, 2:], expected / expected[:, 2:, 2:])

    def test_moves_the_corners_by_what_a_homography_needs_to_do_the_same(self, motion):
        template = Template(picture(), motion)
        matrix = template.matrix(**rows(MOVED[motion]))
        found = Template(picture(), "homography").matrix(corners=template.corners(matrix))
        torch.testing.assert_close(found / found[:, 2:, 2:], matrix / matrix[:, 2:, 2:])


def test_a_similarity_is_that_of_the_similarity_warp():
    class Still(Generator):
        variables = {}  # noqa: RUF012

        def forward(self, **values):
            return Rendering(picture()[None], torch.ones(1, 1, 20, 30).double())

    values = rows(MOVED["similarity"])
    ours, theirs = Template(picture(), "similarity")(**values), SimilarityWarp(Still())(**values)
    blended = ours.image * ours.mask + 1 - ours.mask
    torch.testing.assert_close(blended, theirs.image, rtol=0, atol=1e-12)
    torch.testing.assert_close(ours.mask, theirs.mask, rtol=0, atol=1e-12)


def test_corners_move_by_their_values():
    corners = rows(MOVED["homography"])["corners"]
    template = Template(picture())
    torch.testing.assert_close(template.corners(template.matrix(corners=corners)), corners)


def test_gain_and_bias_change_the_template_and_not_the_fill():
    template = Template(picture(), "similarity", light=True)
    light = rows({"gain": 0.5, "bias": 0.1})
    drawn = template(**rows(MOVED["similarity"]), **light)
    plain = Template(picture(), "similarity")(**rows(MOVED["similarity"]))
    covered = (plain.mask > 0.999).expand_as(plain.image)
    torch.testing.assert_close(drawn.image[covered], 0.5 * plain.image[covered] + 0.1)
    assert (drawn.image[(plain.mask == 0).expand_as(plain.image)] == 1).all()


def test_a_mask_keeps_out_what_is_not_known_of_the_template():
    mask = torch.ones(1, 20, 30).double()
    mask[..., :10] = 0
    drawn = Template(picture(), "similarity", mask=mask)(**rows(STILL["similarity"]))
    assert (drawn.image[..., :10] == 1).all()
    torch.testing.assert_close(drawn.image[0, ..., 10:], picture()[..., 10:], rtol=0, atol=1e-12)
    torch.testing.assert_close(drawn.mask[0], mask, rtol=0, atol=1e-12)


class TestOversampling:
    @pytest.mark.parametrize("motion", STILL)
    def test_leaves_a_picture_that_does_not_move_as_it_is(self, motion):
        drawn = Template(picture(), motion, oversampling=4)(**rows(STILL[motion]))
        torch.testing.assert_close(drawn.image[0], picture(), rtol=0, atol=1e-9)
        assert drawn.mask.min() > 1 - 1e-12

    @pytest.mark.parametrize("motion", STILL)
    def test_draws_what_a_spline_draws_and_bilinear_does_not(self, motion):
        sharp = torch.rand(1, 20, 30, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        values = rows(MOVED[motion])
        matrix = Template(sharp, motion).matrix(**values)[0].inverse().numpy()
        v, u = np.mgrid[:20, :30]
        x, y, z = np.einsum("ij,jhw->ihw", matrix, np.stack([u, v, np.ones_like(u)]))
        expected = torch.from_numpy(map_coordinates(sharp[0].numpy(), [y / z, x / z], order=3, mode="mirror"))

        def apart(oversampling):
            drawn = Template(sharp, motion, oversampling=oversampling)(**values)
            return (drawn.image[0, 0] - expected)[drawn.mask[0, 0] > 0.999].square().mean().sqrt()

        assert apart(8) < 0.01
        assert apart(4) < 0.03
        assert apart(1) > 0.06

    def test_keeps_the_size_the_matrix_and_the_corners(self):
        values = rows(MOVED["homography"])
        plain, fine = Template(picture()), Template(picture(), oversampling=3)
        matrix = plain.matrix(**values)
        torch.testing.assert_close(fine.matrix(**values), matrix)
        torch.testing.assert_close(fine.corners(matrix), plain.corners(matrix))
        assert fine(**values).image.shape == plain(**values).image.shape

    def test_keeps_the_mask_sharp(self):
        mask = torch.ones(1, 20, 30).double()
        mask[..., :10] = 0
        drawn = Template(picture(), "similarity", mask=mask, oversampling=4)(**rows(STILL["similarity"]))
        torch.testing.assert_close(drawn.mask[0], mask, rtol=0, atol=1e-12)
        assert (drawn.image[..., :10] == 1).all()


@pytest.mark.parametrize(
    ("inputs", "error", "message"),
    [
        ({"picture": torch.rand(20, 30)}, ValueError, r"picture must have shape \(B, C, H, W\)"),
        ({"picture": torch.zeros(3, 4, 4, dtype=torch.uint8)}, TypeError, "picture must be a floating-point tensor"),
        (
            {"motion": "rigid"},
            ValueError,
            "motion must be one of translation, .*, got 'rigid'",
        ),
        ({"oversampling": 0}, ValueError, "oversampling must lie between 1 and 16, got 0"),
        ({"fill": torch.rand(3, 20, 30)}, TypeError, "fill must be a number"),
        ({"mask": torch.rand(3, 20, 30)}, ValueError, r"mask must have shape \(1, 20, 30\)"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_a_sentence(inputs, error, message):
    with pytest.raises(error, match=message):
        Template(**{"picture": picture(), **inputs})


@pytest.mark.parametrize("motion", MOVED)
def test_values_that_do_what_a_matrix_does_are_found(motion):
    template = Template(picture(), motion)
    values = rows(MOVED[motion])
    found = values_of(motion, template.matrix(**values), template.size)
    assert set(found) == set(values)
    for name, value in values.items():
        torch.testing.assert_close(found[name], value, rtol=0, atol=1e-9)


def test_a_similarity_comes_as_near_to_an_affine_map_as_opencv_s():
    affine = Template(picture(), "affine").matrix(**rows(MOVED["affine"]))
    found = Template(picture(), "similarity").matrix(**values_of("similarity", affine, (20, 30)))
    corners = np.array([[-0.5, -0.5], [29.5, -0.5], [29.5, 19.5], [-0.5, 19.5]])
    there = corners @ affine[0, :2, :2].numpy().T + affine[0, :2, 2].numpy()
    theirs, _ = cv2.estimateAffinePartial2D(corners, there, method=cv2.LMEDS, refineIters=50)
    assert np.linalg.norm(corners @ found[0, :2, :2].numpy().T + found[0, :2, 2].numpy() - there) <= (
        np.linalg.norm(corners @ theirs[:, :2].T + theirs[:, 2] - there) + 1e-6
    )


class TestABendingMotion:
    @pytest.mark.parametrize("motion", ["tps", "flow"])
    def test_reads_where_its_control_points_say(self, motion):
        control = (4, 5)
        field = 0.1 * torch.randn(1, 2, *control, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        template = Template(picture(19, 29), motion, control=control)
        places = template.places(displacement=field)
        grid = torch.stack(torch.meshgrid(torch.arange(29.0), torch.arange(19.0), indexing="xy"), -1).double()
        moved = (places - grid)[0, ::6, ::7]
        expected = field[0].movedim(0, -1) * torch.tensor([14.5, 9.5], dtype=torch.float64)
        torch.testing.assert_close(moved, expected, rtol=0, atol=1e-9)

    @pytest.mark.parametrize("motion", ["tps", "flow"])
    def test_does_not_move_without_displacement_and_is_no_matrix(self, motion):
        template, still = Template(picture(), motion), torch.zeros(1, 2, 5, 5, dtype=torch.float64)
        torch.testing.assert_close(template(displacement=still).image[0], picture(), rtol=0, atol=1e-12)
        with pytest.raises(ValueError, match="which no matrix does"):
            template.matrix(displacement=still)

    def test_is_dense_with_as_many_control_points_as_pixels(self):
        template = Template(picture(), "flow", control=(20, 30))
        field = torch.zeros(1, 2, 20, 30, dtype=torch.float64)
        field[:, 0] = 1 / 15  # a pixel to the right
        torch.testing.assert_close(template(displacement=field).image[0, :, :, :-1], picture()[:, :, 1:])


def test_a_batch_has_a_template_for_each_problem():
    pictures = torch.stack([picture(), 1 - picture()])
    template = Template(pictures, "translation")
    values = rows(MOVED["translation"])
    both = template(shift=values["shift"].expand(2, 2), template=torch.tensor([1, 0]))
    for row, number in enumerate((1, 0)):
        alone = Template(pictures[number], "translation")(**values)
        torch.testing.assert_close(both.image[row : row + 1], alone.image)
    with pytest.raises(ValueError, match="2 pictures cannot be fitted to 3 problems"):
        template.prepare(Observation(torch.zeros(3, 3, 20, 30)))
