"""Every shipped initializer through one suite; a new one fails until the table below says how to build it."""

import math
from itertools import pairwise

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import nn
from walk import shipped

import kfit.initializers
from kfit.core import (
    Angle,
    Bounded,
    Encoder,
    FitResult,
    Generator,
    History,
    Initializer,
    Observation,
    Positive,
    Rendering,
    Variable,
)
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.initializers import (
    Constant,
    EncoderPosterior,
    FromCamera,
    FromDepth,
    FromMask,
    PosePosterior,
    Previous,
    SphereGrid,
    Uniform,
)
from tests.fixed_head import FixedHead

VARIABLES = {
    "code": Variable((3,)),
    "azimuth": Variable((), Angle()),
    "elevation": Variable((), Angle()),
    "roll": Variable((), Angle()),
    "shift": Variable((2,), Bounded(-1.0, 1.0)),
    "scale": Variable((), Positive()),
    "distance": Variable((), Positive()),
    "focal": Variable((), Positive()),
}


class TinyEncoder(Encoder):
    def __init__(self):
        super().__init__()
        torch.manual_seed(3)
        self.layer = nn.Linear(3, 6)

    def forward(self, image):
        mean, log_variance = self.layer(image.mean((2, 3))).chunk(2, 1)
        return mean, log_variance


class TinyPoseNetwork(FixedHead):
    def __init__(self, symmetry, has_roll=True):
        super().__init__(symmetry, 60.0, has_roll)
        torch.manual_seed(4)
        self.layer = nn.Linear(3, len(self.rotations))

    def forward(self, image):
        return (5 * self.layer(image.mean((2, 3)))).log_softmax(1)


class PerPicture(Initializer):
    """`Previous` of the answers that belong to the pictures' keys, as a video's frames follow one another."""

    def __init__(self, **settings):
        torch.manual_seed(5)
        self.settings, self.on = settings, ("code", "azimuth", "scale")
        self.values = {"code": torch.randn(3, 3), "azimuth": torch.randn(3), "scale": torch.rand(3) + 0.5}

    def __call__(self, variables, observation, num_starts, rngs):
        rows = [key - 11 for key in observation.keys]
        result = answer({name: value[rows] for name, value in self.values.items()})
        return Previous(result, **self.settings)(variables, observation, num_starts, rngs)


def answer(values):
    nothing = torch.zeros(0)
    count = len(next(iter(values.values())))
    return FitResult(
        values, torch.zeros(count), torch.zeros(count).long(), nothing, nothing, nothing, {}, History(nothing, {}, {})
    )


class Ball(Generator):
    """Half a ball at a distance, moved in the picture."""

    def __init__(self):
        super().__init__()
        self.variables = {name: VARIABLES[name] for name in ("scale", "shift", "distance")}

    def forward(self, scale, shift, distance):
        place = torch.linspace(-1, 1, 8) - shift.sum(1, keepdim=True)
        away = (place[:, None, :].square() + place[:, :, None].square()) / scale[:, None, None]
        depth = distance[:, None, None] * (1 - 0.1 * (1 - away).clamp_min(0).sqrt())
        return Rendering(away[:, None].expand(-1, 3, -1, -1), (away < 1)[:, None].float(), depth[:, None])


BUILD = {
    Constant: [lambda: Constant({"scale": 1.5, "shift": [0.1, -0.2]}), lambda: Constant({"shift": 0.25})],
    EncoderPosterior: [lambda: EncoderPosterior(TinyEncoder()), lambda: EncoderPosterior(TinyEncoder(), sigma=0.0)],
    FromCamera: [FromCamera],
    FromDepth: [lambda: FromDepth(Ball(), [Constant({"scale": 1.5}), Uniform("shift", -0.5, 0.5)])],
    FromMask: [FromMask],
    PosePosterior: [
        lambda: PosePosterior(TinyPoseNetwork("none")),
        lambda: PosePosterior(TinyPoseNetwork("y")),
        lambda: PosePosterior(TinyPoseNetwork("none", has_roll=False)),
    ],
    Previous: [PerPicture, lambda: PerPicture(sigma={"azimuth": 0.1, "scale": 0.2})],
    SphereGrid: [
        SphereGrid,
        lambda: SphereGrid((-90.0, 90.0), (30.0, 30.0)),
        lambda: SphereGrid(roll_deg=(-180.0, 180.0)),
    ],
    Uniform: [lambda: Uniform("shift", -0.5, 0.5), lambda: Uniform("scale", 0.5, 2.0)],
}
built = [
    pytest.param(build, id=f"{kind.__name__}-{number}") for kind in BUILD for number, build in enumerate(BUILD[kind])
]


def observation(keys=(11, 12, 13)):
    rng, rows = torch.Generator().manual_seed(0), [key - 11 for key in keys]
    pictures, depth = torch.rand(3, 3, 8, 8, generator=rng), 1 + torch.rand(3, 1, 8, 8, generator=rng)
    mask = torch.zeros(3, 1, 8, 8)
    for row in range(3):
        mask[row, :, row : 4 + row, 1 : 6 - row] = 1
    cameras = torch.diag_embed(torch.tensor([[20.0, 20.0, 1.0], [30.0, 30.0, 1.0], [40.0, 40.0, 1.0]]))
    return Observation(pictures[rows], mask[rows], depth=depth[rows], intrinsics=cameras[rows], keys=keys)


def starts(initializer, observed, num_starts=6, seed=0):
    rngs = [torch.Generator().manual_seed(100 * seed + key) for key in observed.keys]
    return initializer(VARIABLES, observed, num_starts, rngs)


def test_every_shipped_initializer_is_covered_here_and_exported():
    found = shipped(kfit.initializers, Initializer)
    assert found == set(BUILD)
    assert {kind.__name__ for kind in found} <= set(kfit.initializers.__all__)


@pytest.mark.parametrize("build", built)
class TestAnInitializer:
    def test_sets_the_variables_that_it_names_in_their_shapes(self, build):
        initializer = build()
        values = starts(initializer, observation())
        assert tuple(values) == initializer.on
        for name, value in values.items():
            assert value.shape == (18, *VARIABLES[name].shape)
            assert bool(value.isfinite().all())

    def test_gives_a_problem_the_same_numbers_alone_and_in_any_batch(self, build):
        together = starts(build(), observation())
        rotated = starts(build(), observation((13, 11, 12)))
        alone = starts(build(), observation((12,)))
        for name, value in together.items():
            torch.testing.assert_close(value[6:12], alone[name])
            torch.testing.assert_close(value[6:12], rotated[name][12:])

    def test_gives_the_same_numbers_for_the_same_seed(self, build):
        first, again = starts(build(), observation()), starts(build(), observation())
        for name, value in first.items():
            torch.testing.assert_close(value, again[name], rtol=0, atol=0)

    def test_leaves_torch_s_own_random_numbers_alone(self, build):
        initializer = build()
        before = torch.get_rng_state()
        starts(initializer, observation())
        assert torch.equal(torch.get_rng_state(), before)

    @pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize("name", ["image", "mask", "depth"])
    def test_a_picture_that_is_no_number_leaves_the_others_their_starts(self, build, name, broken):
        observed, whole = observation(), starts(build(), observation())
        getattr(observed, name)[1] = broken
        for key, value in starts(build(), observed).items():
            others = [*range(6), *range(12, 18)]
            torch.testing.assert_close(value[others], whole[key][others], rtol=0, atol=0)

    def test_gives_memory_of_its_own_for_every_start(self, build):
        for value in starts(build(), observation()).values():
            before = value[1:].clone()
            value[0] += 1
            torch.testing.assert_close(value[1:], before)


@pytest.mark.parametrize(
    "build",
    [lambda: EncoderPosterior(TinyEncoder()), lambda: Uniform("shift", -0.5, 0.5)],
    ids=["posterior", "uniform"],
)
def test_random_starts_differ_with_seed_problem_and_start(build):
    (first,) = starts(build(), observation()).values()
    (other,) = starts(build(), observation(), seed=1).values()
    assert not torch.allclose(first, other)
    assert not torch.allclose(first[:6], first[6:12])
    assert len(first[:6].unique(dim=0)) == 6


class TestConstant:
    def test_fills_numbers_and_takes_lists(self):
        values = starts(BUILD[Constant][0](), observation(), 2)
        torch.testing.assert_close(values["scale"], torch.full((6,), 1.5))
        torch.testing.assert_close(values["shift"], torch.tensor([[0.1, -0.2]]).expand(6, 2))

    def test_refuses_a_list_of_another_length_by_name(self):
        with pytest.raises(ValueError, match=r"Constant: shift must be a number or of shape \(2,\), got \(3,\)"):
            starts(Constant({"shift": [0.0, 0.0, 0.0]}), observation())


class TestUniform:
    def test_fills_its_range_evenly(self):
        (value,) = starts(Uniform("shift", -0.5, 1.5), observation(), 2000).values()
        assert value.min() >= -0.5
        assert value.max() < 1.5
        assert value.mean().item() == pytest.approx(0.5, abs=0.02)
        assert value.var().item() == pytest.approx(4 / 12, abs=0.01)

    def test_may_be_a_point_but_not_upside_down(self):
        (value,) = starts(Uniform("scale", 2.0, 2.0), observation()).values()
        assert bool((value == 2).all())
        with pytest.raises(ValueError, match="low must not be above high"):
            Uniform("scale", 2.0, 1.0)


class TestEncoderPosterior:
    def test_starts_at_the_mean_and_spreads_by_the_standard_deviation(self):
        observed, encoder = observation(), TinyEncoder()
        mean, log_variance = encoder(observed.image)
        code = starts(EncoderPosterior(encoder, sigma=0.5), observed, 4000)["code"].view(3, 4000, 3)
        torch.testing.assert_close(code[:, 0], mean)
        torch.testing.assert_close(code.mean(1), mean, rtol=0, atol=0.05)
        torch.testing.assert_close(code.std(1), 0.5 * (0.5 * log_variance).exp(), rtol=0.05, atol=0)

    def test_without_spread_starts_all_at_the_mean(self):
        observed, encoder = observation(), TinyEncoder()
        code = starts(EncoderPosterior(encoder, sigma=0.0), observed, 3)["code"]
        torch.testing.assert_close(code, encoder(observed.image)[0].repeat_interleave(3, 0))

    def test_asks_for_no_gradients_and_leaves_its_encoder_as_it_was(self):
        encoder = TinyEncoder().train()
        code = starts(EncoderPosterior(encoder), observation())["code"]
        assert not code.requires_grad
        assert encoder.training
        assert all(p.requires_grad for p in encoder.parameters())


class TestSphereGrid:
    def test_stays_within_its_bounds(self):
        values = starts(SphereGrid((-90.0, 30.0), (-15.0, 75.0)), observation(), 50)
        azimuth, elevation = (values[name].rad2deg() for name in ("azimuth", "elevation"))
        assert -90 <= azimuth.min() < azimuth.max() <= 30
        assert -15 <= elevation.min() < elevation.max() <= 75

    def test_holds_equally_many_starts_in_equal_areas(self):
        values = starts(SphereGrid(), observation((11,)), 1000)
        height, azimuth = values["elevation"].sin(), values["azimuth"]
        edges = torch.linspace(math.sin(math.radians(-15)), math.sin(math.radians(75)), 5, dtype=torch.float64)
        for low, high in pairwise(edges):
            for quarter in range(4):
                left = -math.pi + quarter * math.pi / 2
                inside = (height >= low) & (height < high) & (azimuth >= left) & (azimuth < left + math.pi / 2)
                assert int(inside.sum()) == pytest.approx(1000 / 16, abs=3)

    def test_leaves_no_direction_far_from_a_start(self):
        # 40 starts over the sphere: discs of 4π / 40 each have a radius of 18.2°, and a lattice leaves gaps of less
        # than twice that.
        found = starts(SphereGrid(elevation_deg=(-90.0, 90.0)), observation((11,)), 40)
        direction = torch.stack(
            [found["elevation"].cos() * found["azimuth"].sin(), found["elevation"].sin(),
             found["elevation"].cos() * found["azimuth"].cos()], -1
        )  # fmt: skip
        anywhere = torch.nn.functional.normalize(torch.randn(2000, 3, dtype=torch.float64), dim=1)
        nearest = (anywhere @ direction.T).max(1).values.acos().rad2deg()
        assert nearest.max() < 36

    def test_on_one_ring_is_the_paper_s_even_grid(self):
        values = starts(SphereGrid((-180.0, 180.0), (30.0, 30.0)), observation((11,)), 4)
        torch.testing.assert_close(
            values["azimuth"].rad2deg(), torch.tensor([-135.0, -45.0, 45.0, 135.0], dtype=torch.float64)
        )
        torch.testing.assert_close(values["elevation"].rad2deg(), torch.full((4,), 30.0, dtype=torch.float64))

    def test_of_one_azimuth_spreads_the_elevations_as_a_symmetric_category_needs(self):
        values = starts(SphereGrid((0.0, 0.0), (-90.0, 90.0)), observation((11,)), 4)
        torch.testing.assert_close(values["azimuth"], torch.zeros(4, dtype=torch.float64))
        torch.testing.assert_close(values["elevation"].sin(), torch.tensor([-0.75, -0.25, 0.25, 0.75]).double())

    def test_with_roll_holds_equally_many_starts_in_equal_volumes_of_all_rotations(self):
        values = starts(SphereGrid(elevation_deg=(-90.0, 90.0), roll_deg=(-180.0, 180.0)), observation((11,)), 2000)
        share = [
            (values["elevation"].sin() + 1) / 2,
            values["azimuth"] / math.tau + 0.5,
            values["roll"] / math.tau + 0.5,
        ]
        cell = sum((part * 4).long().clamp(max=3) * 4**place for place, part in enumerate(share))
        assert torch.bincount(cell, minlength=64).sub(2000 / 64).abs().max() < 12

    def test_with_roll_leaves_no_rotation_far_from_a_start(self):
        # 500 starts over all rotations: balls of π² · 8 / 500 each (the whole is 8π²) have a radius of some 33°.
        found = starts(SphereGrid(elevation_deg=(-90.0, 90.0), roll_deg=(-180.0, 180.0)), observation((11,)), 500)
        near = rotation_from_angles(found["azimuth"], found["elevation"], found["roll"])
        anywhere = torch.from_numpy(Rotation.random(300, rng=0).as_matrix())
        least = rotation_error(anywhere[:, None], near).min(1).values.rad2deg()
        assert least.max() < 50
        assert least.mean() < 25

    @pytest.mark.parametrize(
        ("bounds", "name"),
        [
            ({"azimuth_deg": (10.0, 0.0)}, "azimuth_deg"),
            ({"elevation_deg": (0.0, 91.0)}, "elevation_deg"),
            ({"roll_deg": (5.0, -5.0)}, "roll_deg"),
        ],
    )
    def test_refuses_bounds_that_fall_or_leave_the_sphere(self, bounds, name):
        with pytest.raises(ValueError, match=f"SphereGrid: {name} must rise within"):
            SphereGrid(**bounds)
