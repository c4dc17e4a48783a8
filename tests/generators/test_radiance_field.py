"""The volume-rendered generator: it sees with the training camera, and draws colour, mask and depth by the formula."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from kfit.data.light import Light
from kfit.data.rasterizer import render, standard_pose
from kfit.data.shapes.primitives import revolve
from kfit.data.shapes.textures import solid
from kfit.generators import VAE3D, RadianceField, ray_march
from kfit.generators.ray_march import EMPTY
from kfit.models import load

WHITE = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))


def ball_volume(at, radius, sides, count=64):
    """Raw colour and density of a grey ball at a point in box diagonals, its surface where the density is 0."""
    cells = (torch.arange(count) + 0.5) / count - 0.5
    z, y, x = torch.meshgrid(*(cells * side for side in reversed(sides)), indexing="ij")
    away = torch.stack([x - at[0], y - at[1], z - at[2]]).norm(dim=0)
    density = (200 * (radius - away)).clamp(EMPTY, 12)
    return torch.cat([torch.zeros(3, *density.shape), density[None] - EMPTY])[None]


def drawn(field, volume, azimuth_deg=0.0, elevation_deg=0.0, focal=None):
    angles = {"azimuth": azimuth_deg, "elevation": elevation_deg}
    values = {name: torch.tensor([math.radians(angle)]) for name, angle in angles.items()}
    if focal is not None:
        values["focal"] = torch.tensor([focal])
    with torch.no_grad():
        return field._picture(volume, values, field.rays)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "unit_fraction", "sides", "distance"),
    [
        (0, 0, 1.0, (1.0, 1.0, 1.0), 4.0),
        (40, 0, 1.0, (0.6, 0.5, 0.8), 8.0),
        (-60, 50, 1.2, (0.7, 0.9, 0.8), 2.0),
        (130, -15, 0.9, (0.8, 0.5, 1.0), 1.3),
    ],
)
def test_a_ball_is_drawn_where_and_as_large_and_as_far_as_the_rasterizer_draws_it(
    azimuth, elevation, unit_fraction, sides, distance
):
    at, radius = np.array([0.15, 0.1, 0.25]), 0.12
    ring = np.linspace(-np.pi / 2, np.pi / 2, 48)
    ball = revolve(radius * np.stack([np.cos(ring), np.sin(ring)], 1), solid(np.full(3, 0.5)), 48)
    ball = replace(ball, vertices=ball.vertices + at.astype(np.float32))
    place = standard_pose(math.radians(elevation), math.radians(azimuth), distance)
    focal = unit_fraction * math.sqrt(distance**2 - 1 / 4)  # a ball of unit diameter spans the fraction of the picture
    camera = np.array([[64 * focal, 0, 31.5], [0, 64 * focal, 31.5], [0, 0, 1]])
    expected = render(ball, place, camera, (64, 64), WHITE)
    field = RadianceField(num_samples=256, unit_fraction=unit_fraction, sides=sides)
    found = drawn(field, ball_volume(at, radius, sides), azimuth, elevation, focal)
    mask = found.mask[0, 0].numpy()
    assert np.abs(mask - expected.mask).mean() < 0.004  # of a ball that covers some 5 % of the picture
    inside = np.minimum(mask, expected.mask) > 0.99
    assert inside.sum() > 50
    apart = found.depth[0, 0].numpy()[inside] - (expected.depth[inside] - distance)
    assert 0 < apart.mean() < 0.025  # light enters a soft surface a little
    assert apart.std() < 0.005


def test_empty_space_is_white_and_what_is_dense_has_its_own_colour():
    field = RadianceField(image_size=16, num_samples=8)
    empty = drawn(field, torch.zeros(1, 4, 8, 8, 8))
    assert float(empty.image.min()) > 0.999
    assert float(empty.mask.max()) < 1e-3
    full = torch.zeros(1, 4, 8, 8, 8)
    full[:, 0], full[:, 3] = math.log(3), 30 - EMPTY  # red is sigmoid(log 3) = 3/4, the others 1/2
    middle = drawn(field, full).image[0, :, 8, 8]
    torch.testing.assert_close(middle, torch.tensor([0.75, 0.5, 0.5]), rtol=0, atol=1e-4)


def test_what_is_near_hides_what_is_far_by_the_formula():
    field = RadianceField(image_size=1, num_samples=2)
    torch.manual_seed(0)
    volume = torch.randn(1, 4, 6, 6, 6) - torch.tensor([0.0, 0.0, 0.0, EMPTY]).view(1, 4, 1, 1, 1)
    found = drawn(field, volume)
    points = torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]])  # towards the viewer is +z
    samples = torch.nn.functional.grid_sample(volume, points.view(1, 2, 1, 1, 3), align_corners=False)[0, :, :, 0, 0]
    near, far = field.thickness / 2 * torch.log1p(torch.exp(2 * (samples[3] + EMPTY)))
    share = torch.stack([1 - torch.exp(-near), torch.exp(-near) * (1 - torch.exp(-far))])
    torch.testing.assert_close(found.mask.flatten()[0], share.sum())
    torch.testing.assert_close(found.image.flatten(), torch.sigmoid(samples[:3]) @ share + 1 - share.sum())
    torch.testing.assert_close(found.depth.flatten()[0], (share * torch.tensor([-0.25, 0.25])).sum() / share.sum())


def test_does_no_more_arithmetic_than_the_compact_vae3d():
    def multiply_adds(generator):
        with FlopCounterMode(display=False) as counter:
            generator(code=torch.zeros(1, 16), azimuth=torch.zeros(1), elevation=torch.zeros(1))
        return counter.get_total_flops() / 2

    convolutions = multiply_adds(RadianceField())
    assert convolutions == pytest.approx(0.22e9, rel=0.03)
    assert multiply_adds(RadianceField(refined=False)) == pytest.approx(0.17e9, rel=0.03)
    # In training mode, which looks at all samples, once. The counter leaves that out: 24 depths × 64² rays × 4 channels
    # × 8 corners.
    assert convolutions + 24 * 64**2 * 4 * 8 < 0.5 * multiply_adds(VAE3D())
    assert sum(p.numel() for p in RadianceField().parameters()) < sum(p.numel() for p in VAE3D().parameters())


def test_a_refinement_begins_as_next_to_nothing_and_corrects_colour_and_mask_alone():
    torch.manual_seed(0)
    field = RadianceField(3, (4, 3), 4, 16)
    values = {"code": torch.randn(2, 3), "azimuth": torch.tensor([0.3, 2.0]), "elevation": torch.tensor([0.2, 0.5])}
    rays = field.rays
    plain = field._picture(field._volume(values["code"]), values, rays)
    begun = field(**values)
    torch.testing.assert_close(begun.image, plain.image, rtol=0, atol=5e-3)
    torch.nn.init.constant_(field.refinement.output.bias, 1.0)
    found = field(**values)
    assert (found.mask > plain.mask).all()
    assert (found.image > plain.image)[plain.image < 0.99].all()
    torch.testing.assert_close(found.depth, plain.depth)


def test_refined_pictures_are_drawn_whole():
    values = {name: torch.zeros(1, *v.shape) for name, v in RadianceField(3, (4, 3), 4, 16).variables.items()}
    some = torch.tensor([[1, 5, 9], [0, 4, 8]])
    with pytest.raises(ValueError, match=r"whole pictures where refined is true, so pixel_stride must be 1"):
        RadianceField(3, (4, 3), 4, 16)(pixels=some, **values)


@pytest.mark.parametrize("refined", [True, False])
def test_a_held_code_has_its_volume_computed_once(monkeypatch, refined):
    field, calls = RadianceField(3, (4, 3), 4, 16, refined=refined), []
    real = RadianceField._volume
    monkeypatch.setattr(RadianceField, "_volume", lambda self, code: calls.append(len(code)) or real(self, code))
    bound = field.bind(code=torch.zeros(3), elevation=torch.tensor(0.1))
    for _ in range(3):
        bound(azimuth=torch.zeros(5))
    assert calls == [1]
    held, free = bound(azimuth=torch.ones(2)), {"code": torch.zeros(2, 3), "elevation": torch.full((2,), 0.1)}
    torch.testing.assert_close(held.image, field(azimuth=torch.ones(2), **free).image)


def test_what_sticks_out_of_the_box_is_not_drawn():
    field = RadianceField(image_size=32, sides=(0.25, 0.5, 0.75))
    full = torch.zeros(1, 4, 8, 8, 8)
    full[:, 3] = 30 - EMPTY
    for azimuth, wide in ((0.0, 0.25), (90.0, 0.75)):
        mask = drawn(field, full, azimuth).mask[0, 0]
        # The camera stands near: the front face looms.
        near = 4 / (4 - (0.75 if azimuth == 0 else 0.25) / 2)
        assert mask[16].sum() / 32 == pytest.approx(wide * near, abs=0.07)
        assert mask[:, 16].sum() / 32 == pytest.approx(0.5 * near, abs=0.07)
        assert mask[0].max() < 1e-6  # rays that miss the box see nothing


def test_a_camera_inside_the_object_is_refused():
    with pytest.raises(ValueError, match="RadianceField: distance"):
        RadianceField(distance=0.4)
    with pytest.raises(ValueError, match="RadianceField: unit_fraction"):
        RadianceField(unit_fraction=0.0)
    for sides in ((1.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.2, 1.0)):
        with pytest.raises(ValueError, match=r"RadianceField: sides must (hold 3 items|lie between 0.001 and 1)"):
            RadianceField(sides=sides)


def test_single_pixels_are_those_of_the_whole_picture():
    torch.manual_seed(0)
    field = RadianceField(4, (8, 4), 6, image_size=16, refined=False)
    values = {"code": torch.randn(2, 4), "azimuth": torch.tensor([0.3, 2.0]), "elevation": torch.tensor([0.5, -0.2])}
    with torch.no_grad():
        whole = field(**values)
        some = field(**values, pixels=torch.tensor([[1, 4, 15], [0, 7, 8]]))
    for name in ("image", "mask", "depth"):
        torch.testing.assert_close(getattr(some, name), getattr(whole, name)[..., [1, 4, 15], :][..., [0, 7, 8]])


def test_evaluation_skips_empty_space_and_draws_and_slopes_the_same(monkeypatch):
    field = load("mug").generator
    rng = torch.Generator().manual_seed(0)
    variables = {name: v for name, v in field.variables.items() if name != "focal"}
    raw = {name: 0.7 * torch.randn(3, *v.shape, generator=rng) for name, v in variables.items()}
    values = raw | {"focal": torch.tensor([1.5, 3.0, 6.0])}
    looked = []
    sampled = ray_march._sampled
    monkeypatch.setattr(ray_march, "_sampled", lambda *args: looked.append(len(args[1])) or sampled(*args))
    pictures, slopes = [], []
    for training in (True, False):
        field.train(training)
        leaves = {name: value.clone().requires_grad_() for name, value in values.items()}
        observed = field(**leaves)
        # Depth where next to nothing is drawn is that of the few samples that count.
        depth = observed.depth * (observed.mask > 0.01)
        energy = (observed.image - 0.3).square().sum() + observed.mask.sum() + depth.square().sum()
        slopes.append(torch.autograd.grad(energy, list(leaves.values())))
        pictures.append(observed)
    assert looked == [pytest.approx(0.15 * 3 * 24 * 64**2, rel=0.5)]
    for name in ("image", "mask"):
        torch.testing.assert_close(pictures[1].field(name), pictures[0].field(name), rtol=0, atol=2e-3)
    for apart, exact in zip(slopes[1], slopes[0], strict=True):
        assert torch.nn.functional.cosine_similarity(apart.flatten(), exact.flatten(), dim=0) > 0.99


def test_an_empty_box_is_drawn_white():
    field = RadianceField().eval()
    nothing = torch.zeros(2, 4, 32, 32, 32, requires_grad=True)
    observed = field._picture(nothing, {"azimuth": torch.zeros(2), "elevation": torch.zeros(2)}, field.rays)
    assert bool((observed.image == 1).all())
    assert bool((observed.mask == 0).all())
    assert bool((observed.depth == 0).all())
    observed.image.sum().backward()
    assert nothing.grad.abs().sum() == 0
