"""Every shipped generator through one suite; a new one fails until the table below says how to build it."""

import math
from itertools import chain, combinations

import pytest
import torch
from torch import nn
from walk import shipped

import kfit.generators
from kfit.core import Angle, Encoder, Generator, Positive, Rendering, frozen
from kfit.generators import (
    VAE2D,
    VAE3D,
    ConvEncoder,
    MeshInCamera,
    MeshRenderer,
    MetricDepth,
    MultiView,
    OnnxGenerator,
    RadianceField,
    SimilarityWarp,
    Template,
    VolumeTemplate,
)


def tiny_vae3d():
    torch.manual_seed(2)
    return VAE3D(code_dim=3, volume_dims=(4, 3), projection_dim=4, decoder_dims=(3,))


def tiny_vae2d():
    torch.manual_seed(2)
    return VAE2D(code_dim=3, decoder_dims=(4, 4, 3), depth=True)


def tiny_field():
    torch.manual_seed(2)
    return RadianceField(code_dim=3, volume_dims=(4, 3), num_samples=4, image_size=16)


def tiny_mesh():
    """A lopsided tetrahedron whose corners have colours of their own."""
    vertices = torch.tensor([[-0.4, -0.3, -0.2], [0.45, -0.25, 0.0], [-0.1, -0.2, 0.4], [0.1, 0.35, 0.05]])
    faces = torch.tensor([[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    texture = torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(2))
    uv = torch.tensor([[0.1, 0.1], [0.9, 0.2], [0.2, 0.9], [0.8, 0.8]])
    return MeshRenderer(vertices, faces, uv, texture, num_points=400, image_size=16)


def tiny_mesh_in_camera():
    vertices = torch.tensor([[-0.4, -0.3, -0.2], [0.45, -0.25, 0.0], [-0.1, -0.2, 0.4], [0.1, 0.35, 0.05]])
    faces = torch.tensor([[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    texture = torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(2))
    uv = torch.tensor([[0.1, 0.1], [0.9, 0.2], [0.2, 0.9], [0.8, 0.8]])
    camera = torch.tensor([[40.0, 0, 7.5], [0, 40, 7.5], [0, 0, 1]])
    return MeshInCamera(vertices - torch.tensor([0, 0, -3.0]), faces, uv, texture, (16, 16), camera, num_points=400)


# How to build a small one, and the shapes of its variables.
POSE = {"code": (3,), "azimuth": (), "elevation": ()}
PLANE = {"roll": (), "shift": (2,), "scale": ()}
BUILD = {
    VAE3D: (tiny_vae3d, POSE),
    VAE2D: (tiny_vae2d, POSE),
    RadianceField: (tiny_field, POSE | {"focal": ()}),
    SimilarityWarp: (lambda: SimilarityWarp(tiny_vae3d()), POSE | PLANE),
    MetricDepth: (
        lambda: MetricDepth(SimilarityWarp(tiny_field()), 1.1),
        POSE | PLANE | {"distance": (), "focal": ()},
    ),
    MeshRenderer: (tiny_mesh, {"azimuth": (), "elevation": ()} | PLANE),
    MeshInCamera: (tiny_mesh_in_camera, {"rotation": (3, 3), "translation": (3,)}),
    Template: (
        lambda: Template(torch.rand(3, 16, 16, generator=torch.Generator().manual_seed(2))),
        {"corners": (4, 2)},
    ),
}
# Draws without gradients, in single precision: tests/generators/test_onnx_generator.py
WITHOUT_GRADIENTS = {OnnxGenerator}
# Draws by what it prepared for an observation: tests/pose/test_several_views.py
WITH_CONTEXT = {MultiView}
# Draws volumes: tests/generators/test_volume_template.py
OF_VOLUMES = {VolumeTemplate}
IN_DEPTH_ALONE = {"distance"}  # variables that neither colour nor mask show
SMALL = {"rotation": 0.03, "translation": 0.1, "roll": 0.2, "shift": 0.1, "scale": 0.1, "corners": 0.1}


def random_values(generator, rows, dtype=torch.float32):
    rng = torch.Generator().manual_seed(7)
    values = {}
    for name, variable in generator.variables.items():
        raw = SMALL.get(name, 0.5) * torch.randn(rows, *variable.raw_shape, generator=rng, dtype=torch.float64)
        values[name] = variable.space.to_value(raw).to(dtype)
    return values


def fields(rendering):
    return {n: getattr(rendering, n) for n in ("image", "mask", "depth") if getattr(rendering, n) is not None}


def drawn_twice(generator, values):
    """What is drawn without and with slopes, and the slopes."""
    with torch.no_grad():
        plain = list(fields(generator(**values)).values())
    leaves = [value.clone().requires_grad_() for value in values.values()]
    drawn = list(fields(generator(**dict(zip(values, leaves, strict=True)))).values())
    slopes = torch.autograd.grad(sum(picture.square().sum((1, 2, 3)) for picture in drawn).sum(), leaves)
    return [*plain, *(picture.detach() for picture in drawn), *slopes]


def subsets(names, sizes):
    return chain.from_iterable(combinations(names, size) for size in sizes)


def test_every_shipped_generator_is_covered_here_and_exported():
    found = shipped(kfit.generators, Generator)
    assert found == set(BUILD) | WITHOUT_GRADIENTS | WITH_CONTEXT | OF_VOLUMES
    assert {kind.__name__ for kind in found | shipped(kfit.generators, Encoder)} <= set(kfit.generators.__all__)


@pytest.mark.parametrize("kind", BUILD, ids=lambda kind: kind.__name__)
class TestAGenerator:
    def test_names_its_variables_with_their_shapes(self, kind):
        build, shapes = BUILD[kind]
        assert {name: variable.shape for name, variable in build().variables.items()} == shapes

    def test_draws_pictures_of_the_right_shape_and_range(self, kind):
        generator = BUILD[kind][0]()
        rendering = generator(**random_values(generator, 3))
        assert isinstance(rendering, Rendering)
        assert rendering.image.shape == (3, 3, 16, 16)
        for name, picture in fields(rendering).items():
            assert picture.shape == (3, 3 if name == "image" else 1, 16, 16)
            assert picture.dtype == torch.float32
            if name != "depth":
                assert picture.min() >= 0
                assert picture.max() <= 1 + 1e-6

    def test_draws_each_row_as_if_it_were_alone(self, kind):
        generator = BUILD[kind][0]().double()
        values = random_values(generator, 3, torch.float64)
        together = fields(generator(**values))
        for row in range(3):
            alone = fields(generator(**{name: value[row : row + 1] for name, value in values.items()}))
            for name, picture in alone.items():
                torch.testing.assert_close(together[name][row : row + 1], picture, rtol=1e-12, atol=1e-12)

    def test_a_row_s_picture_has_no_gradient_for_another_row(self, kind):
        generator = BUILD[kind][0]()
        values = {name: value.requires_grad_() for name, value in random_values(generator, 3).items()}
        sum(picture[1].square().sum() for picture in fields(generator(**values)).values()).backward()
        for value in values.values():
            assert value.grad[1].abs().sum() > 0
            assert value.grad[[0, 2]].abs().sum() == 0

    def test_gradients_reach_every_variable(self, kind):
        generator = BUILD[kind][0]()
        values = {name: value.requires_grad_() for name, value in random_values(generator, 3).items()}
        for name, picture in fields(generator(**values)).items():
            observed = {k: v for k, v in values.items() if name == "depth" or k not in IN_DEPTH_ALONE}
            slopes = torch.autograd.grad(picture.square().sum(), list(observed.values()), retain_graph=True)
            for variable, slope in zip(observed, slopes, strict=True):
                assert bool(slope.isfinite().all()), (name, variable)
                assert bool((slope.reshape(3, -1).abs().sum(1) > 0).all()), (name, variable)

    def test_gradients_are_those_of_finite_differences(self, kind):
        generator = BUILD[kind][0]().double()
        values = random_values(generator, 1, torch.float64)
        names = list(values)

        def draw(*args):
            return tuple(fields(generator(**dict(zip(names, args, strict=True)))).values())

        assert torch.autograd.gradcheck(draw, [values[name].requires_grad_() for name in names], fast_mode=True)

    @pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi, -math.pi, 7 * math.pi])
    def test_gradients_are_finite_straight_ahead_from_above_and_behind(self, kind, turn):
        generator = BUILD[kind][0]()
        values = {}
        for name, variable in generator.variables.items():
            still = 1.0 if isinstance(variable.space, Positive) else turn if isinstance(variable.space, Angle) else 0.0
            values[name] = torch.full((2, *variable.shape), still, requires_grad=True)
        total = sum(picture.sum() for picture in fields(generator(**values)).values())
        slopes = torch.autograd.grad(total, list(values.values()), allow_unused=True)
        assert all(slope is None or slope.isfinite().all() for slope in slopes)

    @pytest.mark.parametrize(
        "broken", [math.nan, 1e30, *(pytest.param(value, marks=pytest.mark.slow) for value in (math.inf, -math.inf))]
    )
    def test_a_value_that_is_no_number_reaches_no_other_row_s_picture_or_slope(self, kind, broken):
        generator = BUILD[kind][0]()
        whole = random_values(generator, 3)
        for name, value in whole.items():
            spoilt = {**whole, name: value.index_fill(0, torch.tensor([1]), broken)}
            for expected, found in zip(drawn_twice(generator, whole), drawn_twice(generator, spoilt), strict=True):
                torch.testing.assert_close(found[[0, 2]], expected[[0, 2]], rtol=1e-5, atol=1e-5)

    def test_draws_in_the_type_of_its_numbers(self, kind):
        generator = BUILD[kind][0]().double()
        drawn = fields(generator(**random_values(generator, 1, torch.float64)))
        assert {picture.dtype for picture in drawn.values()} == {torch.float64}

    @pytest.mark.parametrize("several", [False, pytest.param(True, marks=pytest.mark.slow)])
    def test_binding_any_variables_leaves_the_picture_as_it_was(self, kind, several):
        generator = BUILD[kind][0]().double()
        values = random_values(generator, 2, torch.float64)
        for names in subsets(list(values), range(2, len(values)) if several else {1, len(values)}):
            fixed = {name: values[name][0] for name in names}
            free = {name: value for name, value in values.items() if name not in names}
            bound = generator.bind(**fixed)
            assert list(bound.variables) == list(free)
            rows = 2 if free else 1
            held = {name: value.expand(rows, *value.shape) for name, value in fixed.items()}
            expected = fields(generator(**free, **held))
            for name, picture in fields(bound(**free)).items():
                assert picture.shape == expected[name].shape, names
                torch.testing.assert_close(picture, expected[name], rtol=1e-12, atol=1e-12)

    def test_bound_ones_can_be_bound_again_frozen_and_converted(self, kind):
        generator = BUILD[kind][0]().eval()
        values = random_values(generator, 1)
        expected = generator(**values).image
        bound = generator
        for name in list(values):
            bound = frozen(bound.bind(**{name: values.pop(name)[0]}))
            torch.testing.assert_close(bound(**values).image, expected)
        assert bound.double()(**values).image.dtype == torch.float64

    def test_bound_ones_still_give_gradients_to_what_is_free(self, kind):
        generator = BUILD[kind][0]()
        values = random_values(generator, 2)
        first, *others = values
        if not others:
            pytest.skip("it has one variable only")
        bound = frozen(generator.bind(**{first: values.pop(first)[0]}))
        free = {name: value.requires_grad_() for name, value in values.items()}
        sum(picture.square().sum() for picture in fields(bound(**free)).values()).backward()
        assert all(bool((value.grad.view(2, -1).abs().sum(1) > 0).all()) for value in free.values())

    def test_binding_refuses_unknown_names_and_wrong_shapes_by_name(self, kind):
        generator = BUILD[kind][0]()
        names = ", ".join(sorted(generator.variables))
        with pytest.raises(ValueError, match=f"bind: unknown zoom; the names are {names}"):
            generator.bind(zoom=torch.tensor(1.0))
        for name, (value,) in random_values(generator, 1).items():
            with pytest.raises(ValueError, match=f"bind: {name} must have shape"):
                generator.bind(**{name: value[None]})

    def test_autocast_leaves_the_geometry_in_full_precision(self, kind, monkeypatch):
        generator, recorded = BUILD[kind][0](), []
        for module, name in (("vae3d", "warp_affine3d"), ("similarity_warp", "warp_affine")):
            real = getattr(getattr(kfit.generators, module), name)

            def spy(x, matrix, *args, real=real, **settings):
                recorded.append((x.dtype, matrix.dtype, matrix, torch.is_autocast_enabled("cpu")))
                return real(x, matrix, *args, **settings)

            monkeypatch.setattr(f"kfit.generators.{module}.{name}", spy)
        values = random_values(generator, 2)
        generator(**values)
        plain = len(recorded)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            rendering = generator(**values)
        assert rendering.image.dtype == torch.float32
        for (*_, expected, _), (x_dtype, dtype, matrix, autocast) in zip(
            recorded[:plain], recorded[plain:], strict=True
        ):
            assert (x_dtype, dtype, autocast) == (torch.float32, torch.float32, False)
            torch.testing.assert_close(matrix, expected)


def test_a_held_code_has_its_volume_computed_once(monkeypatch):
    generator, calls = tiny_vae3d(), []
    real = VAE3D._volume
    monkeypatch.setattr(VAE3D, "_volume", lambda self, code: calls.append(len(code)) or real(self, code))
    bound = SimilarityWarp(generator).bind(code=torch.zeros(3), elevation=torch.tensor(0.1), scale=torch.tensor(1.0))
    for _ in range(3):
        bound(azimuth=torch.zeros(5), roll=torch.zeros(5), shift=torch.zeros(5, 2))
    assert calls == [1]


def test_angles_and_scale_live_in_their_spaces():
    variables = SimilarityWarp(tiny_vae3d()).variables
    assert {name for name, v in variables.items() if v.space == Angle()} == {"azimuth", "elevation", "roll"}
    assert {name for name, v in variables.items() if v.space == Positive()} == {"scale"}


def test_a_warp_refuses_a_generator_that_has_been_warped_already():
    with pytest.raises(ValueError, match="has roll, shift, scale already"):
        SimilarityWarp(SimilarityWarp(tiny_vae3d()))


class Oblong(Generator):
    """A generator of somebody else's: an RGB ramp that has depth."""

    def __init__(self):
        super().__init__()
        self.variables = {}
        self.pixels = nn.Parameter(torch.rand(1, 3, 6, 10, generator=torch.Generator().manual_seed(0)))

    def forward(self, **values):
        mask = torch.zeros(1, 1, 6, 10)
        mask[..., 1:5, 2:8] = 1
        return Rendering(self.pixels, mask, torch.linspace(-0.1, 0.1, 10).expand(1, 1, 6, 10))


def test_a_warped_generator_may_draw_one_picture_for_all_rows():
    rows = {"roll": torch.tensor([0.0, 0.5]), "shift": torch.zeros(2, 2), "scale": torch.ones(2)}
    drawn = SimilarityWarp(Oblong())(**rows)
    for name, picture in fields(drawn).items():
        assert picture.shape == (2, 3 if name == "image" else 1, 6, 10)
        assert not torch.allclose(picture[0], picture[1])


class TestAnEncoder:
    @pytest.mark.parametrize("instance_norm", [False, True])
    def test_gives_mean_and_log_variance_of_each_picture_alone(self, instance_norm):
        torch.manual_seed(0)
        encoder = ConvEncoder(5, (8, 16), 12, 16, instance_norm=instance_norm).double()
        image = torch.rand(3, 3, 16, 16, dtype=torch.float64)
        for part, alone in zip(encoder(image), encoder(image[1:2]), strict=True):
            assert part.shape == (3, 5)
            assert part.dtype == torch.float64
            torch.testing.assert_close(part[1:2], alone, rtol=1e-12, atol=1e-12)

    def test_sees_the_tint_and_begins_all_but_certain(self):
        torch.manual_seed(0)
        grey = torch.full((1, 3, 16, 16), 0.5)
        red = grey + torch.tensor([0.1, -0.05, -0.05]).view(1, 3, 1, 1)
        apart = {}
        for grid in (0, 4):
            torch.manual_seed(0)
            encoder = ConvEncoder(5, (8, 16), 12, 16, tint_grid=grid)
            apart[grid] = float((encoder(red)[0] - encoder(grey)[0]).norm().detach())
            assert bool((encoder(grey)[1] < -3).all())
        assert apart[4] > 2 * apart[0]

    def test_speaks_in_full_precision_under_autocast(self):
        with torch.autocast("cpu", dtype=torch.bfloat16):
            mean, log_variance = ConvEncoder(5, (8, 16), 12, 16)(torch.rand(2, 3, 16, 16))
        assert mean.dtype == log_variance.dtype == torch.float32

    def test_has_the_released_sizes_if_asked(self):
        # 3→64→128→256→512 by 3×3, then 512·4·4 → 128 → 32: weights and biases counted by hand.
        encoder = ConvEncoder(16, (64, 128, 256, 512), 128, 64, tint_grid=0, instance_norm=True)
        convolutions = sum(9 * a * b + b for a, b in ((3, 64), (64, 128), (128, 256), (256, 512)))
        assert sum(p.numel() for p in encoder.parameters()) == convolutions + 8192 * 128 + 128 + 128 * 32 + 32


def test_extents_are_positive_of_length_one_and_in_the_type_of_the_code():
    torch.manual_seed(0)
    head = kfit.generators.ExtentsHead(4, 8)
    for code in (50 * torch.randn(6, 4), 50 * torch.randn(6, 4, dtype=torch.float64)):
        extents = head.to(code.dtype)(code)
        assert extents.dtype == code.dtype
        assert bool((extents > 0).all())
        torch.testing.assert_close(extents.norm(dim=1), torch.ones(6, dtype=code.dtype))
