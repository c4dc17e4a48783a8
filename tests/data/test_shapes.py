"""Procedural objects: every category builds, stands upright in NOCS's frame, and keeps its held-out families apart."""

import functools
import importlib

import numpy as np
import pytest

from kfit.data import shapes
from kfit.data.light import Light
from kfit.data.rasterizer import pose_view
from kfit.data.shapes import CATEGORIES, laptop

build = functools.cache(shapes.build)
EVEN = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
BOTH = pytest.mark.parametrize("held_out", [False, True], ids=["train", "held out"])
EVERY = pytest.mark.parametrize("category", CATEGORIES)


@EVERY
@pytest.mark.parametrize("held_out", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["train", "held out"])
def test_objects_are_finite_centred_and_of_unit_diagonal(category, held_out):
    for seed in range(4):
        mesh, _ = build(category, seed, held_out)
        low, high = mesh.bounds
        assert np.isfinite(mesh.vertices).all()
        np.testing.assert_allclose(low + high, 0, atol=1e-5)
        assert np.linalg.norm(high - low) == pytest.approx(1, abs=1e-5)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        assert mesh.uv.min() >= 0
        assert mesh.uv.max() <= 1
        assert 1000 < len(mesh.faces) < 20000
        assert 0 < mesh.exposure.min() <= mesh.exposure.max() <= 1


@EVERY
def test_the_same_seed_gives_the_same_object_and_another_seed_another(category):
    (first, light), (again, same), (other, _) = (shapes.build(category, seed) for seed in (3, 3, 4))
    for name in ("vertices", "faces", "normals", "uv", "texture", "exposure"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_array_equal(light.colors, same.colors)
    assert first.vertices.shape != other.vertices.shape or not np.allclose(first.vertices, other.vertices)


@EVERY
def test_families_of_training_and_of_validation_are_disjoint(category):
    module = importlib.import_module(f"kfit.data.shapes.{category}")
    assert len(module.SHAPES) >= 4
    assert len(module.HELD_OUT_SHAPES) >= 2
    assert not set(module.SHAPES) & set(module.HELD_OUT_SHAPES)
    assert not set(module.TEXTURES) & set(module.HELD_OUT_TEXTURES)
    drawn = {family for family, _ in module.TEXTURES.values()}
    assert not drawn & {family for family, _ in module.HELD_OUT_TEXTURES.values()}


@EVERY
def test_objects_show_something_from_every_side(category):
    mesh, light = build(category, 1)
    for azimuth in np.arange(4) * np.pi / 2:
        view = pose_view(mesh, 0.5, azimuth, light, image_size=32)
        assert view.mask.mean() > 0.05
        assert np.ptp(view.image[view.mask == 1], axis=0).max() > 0.02


@BOTH
def test_a_mugs_handle_is_on_the_right_at_azimuth_zero(held_out):
    for seed in range(5):
        mesh, _ = build("mug", seed, held_out)
        columns = pose_view(mesh, 0, 0, EVEN).mask.sum(axis=0)
        # The box is centred, so the body, which covers most, is pushed to the other side.
        assert np.average(np.arange(64), weights=columns) < 30.5
        assert mesh.extents[0] > mesh.extents[2]


def test_a_positive_elevation_shows_the_inside_of_a_mug():
    mesh, _ = build("mug", 2)
    above = pose_view(mesh, np.deg2rad(60), 0, EVEN)
    below = pose_view(mesh, np.deg2rad(-60), 0, EVEN)
    low = mesh.bounds[0][1]
    floor = (np.hypot(above.coords[..., 0], above.coords[..., 2]) < 0.3) & (above.mask == 1)
    assert (above.coords[floor][:, 1] < low + 0.25).any()
    np.testing.assert_allclose(below.coords[below.mask == 1][:, 1].min(), low, atol=0.02)


@BOTH
def test_a_laptops_screen_faces_plus_x_and_its_base_is_low(held_out, monkeypatch):
    monkeypatch.setattr("kfit.data.shapes.laptop._opening_deg", lambda rng: 108.0)
    for seed in range(5):
        mesh, _ = shapes.build("laptop", seed, held_out)
        low, high = mesh.bounds
        top = mesh.vertices[mesh.vertices[:, 1] > high[1] - 0.05]
        front = mesh.vertices[mesh.vertices[:, 0] > high[0] - 0.1]
        assert top[:, 0].mean() < -0.05
        assert front[:, 1].max() < low[1] + 0.35 * (high[1] - low[1])
        screen = (mesh.normals[:, 0] > 0.5) & (mesh.vertices[:, 1] > 0)
        assert screen.sum() > 20


@pytest.mark.slow
def test_laptops_stand_at_every_angle_of_the_hinge(monkeypatch):
    opening = [laptop._opening_deg(np.random.default_rng(seed)) for seed in range(200)]
    assert min(opening) < 20
    assert max(opening) > 165
    heights = []
    for degrees in (6, 100, 180):
        monkeypatch.setattr(laptop, "_opening_deg", lambda rng, degrees=degrees: degrees)
        heights.append(laptop.build(np.random.default_rng(3), False).extents[1])
    assert max(heights[0], heights[2]) < 0.25 < 0.5 < heights[1]


@BOTH
def test_a_cameras_lens_points_to_plus_x(held_out):
    for seed in range(5):
        mesh, _ = build("camera", seed, held_out)
        high = mesh.bounds[1]
        tip = mesh.vertices[mesh.vertices[:, 0] > high[0] - 0.01]
        sigma = np.ptp(tip, axis=0)
        assert sigma[1] == pytest.approx(sigma[2], rel=0.1)


@pytest.mark.parametrize("category", ["bottle", "bowl", "can"])
def test_round_objects_stand_on_their_lower_end(category):
    for seed in range(5):
        mesh, _ = build(category, seed)
        down = mesh.normals[:, 1] < -0.95
        assert mesh.vertices[down, 1].min() == pytest.approx(mesh.bounds[0][1], abs=0.02)


def test_unknown_categories_and_negative_seeds_are_refused():
    with pytest.raises(ValueError, match=r"category must be one of .* got 'cup'"):
        build("cup", 0)
    with pytest.raises(ValueError, match="seed must be at least 0"):
        build("mug", -1)
