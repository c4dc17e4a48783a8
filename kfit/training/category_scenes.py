"""Pictures of procedural objects, of other objects, and of background, in front of scikit-image's photos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.data import Light, Mesh, View, join, render, shapes
from kfit.data.rasterizer import standard_intrinsics, standard_pose
from kfit.data.shapes import colors, prints, textures
from kfit.data.shapes.primitives import revolve, sheet, tube

SIDE = 256
# Photos with nothing of kfit's categories in them, but for one camera on a tripod.
PHOTOS = (
    "astronaut.png", "chelsea.png", "rocket.jpg", "motorcycle_left.png", "brick.png", "grass.png", "gravel.png",
    "retina.jpg", "hubble_deep_field.jpg", "ihc.png", "color.png", "page.png", "text.png", "coins.png", "camera.png",
    "moon.png", "clock_motion.png",
)  # fmt: skip
LEAST_PIXELS = 700
SKINS: tuple[Callable[..., NDArray], ...] = (
    textures.plain,
    textures.stripes,
    textures.marble,
    prints.photo,
    prints.label,
)


@dataclass(frozen=True)
class Scene:
    """A picture with an object.

    Attributes:
        image: (S, S, 3) uint8.
        box: (4,) left, top, right, bottom of the object in pixels.
    """

    image: NDArray[np.uint8]
    box: NDArray[np.float64]


def object_scene(category: str, seed: int, rng: np.random.Generator) -> Scene:
    """Draw an object of a category, of any shape and texture family, standing or lying."""
    return _before_photo(*shapes.build(category, seed, held_out=bool(rng.random() < 0.4)), rng)


def other_scene(rng: np.random.Generator) -> Scene:
    """Draw an object of no category: a box, an egg, a bent stick or a body of revolution with a random profile."""
    return _before_photo(_other(rng).normalised(), Light.random(rng), rng)


def empty_scene(rng: np.random.Generator) -> Scene:
    """Return a box without an object: a random part of a photo."""
    size = rng.uniform(0.25, 0.95, 2) * SIDE
    corner = rng.uniform(0, 1, 2) * (SIDE - size)
    return Scene(_as_bytes(_background(rng)), np.array([*corner, *(corner + size)]))


def _before_photo(mesh: Mesh, light: Light, rng: np.random.Generator) -> Scene:
    ground = _background(rng)
    while True:
        view = _view(mesh, light, rng)
        there = view.mask > 0.5
        if there.sum() >= LEAST_PIXELS:
            break
    if rng.random() < 0.5:
        offset = (int(rng.integers(0, 12)), int(rng.integers(-12, 13)))
        shadow = cv2.GaussianBlur(np.roll(view.mask, offset, (0, 1)), (0, 0), rng.uniform(3, 15))
        ground = ground * (1 - rng.uniform(0.2, 0.7) * shadow[..., None])
    cover = view.mask[..., None]
    image = ground * (1 - cover) + (view.image - 1 + cover).clip(0, 1)
    left, top, width, height = cv2.boundingRect(there.astype(np.uint8))
    return Scene(_as_bytes(_photographed(image, rng)), np.array([left, top, left + width, top + height], np.float64))


def _view(mesh: Mesh, light: Light, rng: np.random.Generator) -> View:
    stands = rng.random() < 0.8
    elevation = np.deg2rad(rng.uniform(-10, 80) if stands else rng.uniform(-90, 90))
    roll = np.deg2rad(rng.normal(0, 8)) if stands else rng.uniform(-np.pi, np.pi)
    distance = rng.uniform(1.6, 4)
    pose = standard_pose(elevation, rng.uniform(-np.pi, np.pi), distance)
    cos, sin = np.cos(roll), np.sin(roll)
    pose[:2, :3] = np.array([[cos, -sin], [sin, cos]]) @ pose[:2, :3]
    camera = standard_intrinsics(SIDE, distance, rng.uniform(0.35, 0.85))
    camera[:2, 2] = rng.uniform(0.3, 0.7, 2) * SIDE
    return render(mesh, pose, camera, (SIDE, SIDE), light)


def _photographed(image: NDArray, rng: np.random.Generator) -> NDArray:
    """Change exposure, cast, noise and sharpness."""
    image = image.clip(0, 1) ** rng.uniform(0.7, 1.4) * rng.uniform(0.7, 1.15) * (1 + rng.normal(0, 0.06, 3))
    image = image + rng.normal(0, rng.uniform(0, 0.03), image.shape)
    return cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.5)) if rng.random() < 0.4 else image


def _background(rng: np.random.Generator) -> NDArray:
    """Return a part of a photo, or a uniform background; half of the time with a table below."""
    if rng.random() < 0.75:
        photo = _photo(PHOTOS[rng.integers(len(PHOTOS))])
        size = int(min(photo.shape[:2]) * rng.uniform(0.25, 1))
        top, left = (rng.integers(side - size + 1) for side in photo.shape[:2])
        part = photo[top : top + size, left : left + size]
        how = cv2.INTER_AREA if size > SIDE else cv2.INTER_CUBIC
        ground = cv2.resize(part, (SIDE, SIDE), interpolation=how).astype(np.float32) / 255
    else:
        ground = _surface(rng, (textures.wood, textures.marble, textures.plain)[rng.integers(3)])
    if rng.random() < 0.5:
        ground = cv2.GaussianBlur(ground, (0, 0), rng.uniform(0.5, 4))
    if rng.random() < 0.5:
        edge = int(SIDE * rng.uniform(0.3, 0.8))
        ground[edge:] = _surface(rng, (textures.wood, textures.plain)[rng.integers(2)])[edge:]
    return np.asarray(ground)


def _surface(rng: np.random.Generator, skin: Callable[..., NDArray]) -> NDArray:
    tile = skin(rng, colors.any_color(rng), (128, 128))
    return np.asarray(cv2.resize(tile, (SIDE, SIDE)), np.float32) / np.float32(255)


def _other(rng: np.random.Generator) -> Mesh:
    skin = SKINS[rng.integers(len(SKINS))](rng, colors.any_color(rng), (128, 128))
    kind = rng.integers(4)
    if kind == 0:
        return _box(rng.uniform(0.2, 1, 3), skin)
    if kind == 1:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 24)
        radius = np.maximum(np.cos(angle) * rng.uniform(0.5, 1.2), 1e-4)
        return revolve(np.stack([radius, np.sin(angle)], 1), skin)
    if kind == 2:
        along, bend = np.linspace(0, 1, 24), rng.uniform(0.1, 2.5)
        path = np.stack([np.sin(bend * along), 1 - np.cos(bend * along), np.zeros(24)], 1) / bend
        thickness = np.sin(np.pi * (0.9 * along + 0.05)) ** 0.4
        return tube(path, rng.uniform(0.05, 0.25, 2) * thickness[:, None], skin)
    radius = np.abs(np.cumsum(rng.normal(0, 0.12, 12))) + 0.05
    return revolve(np.stack([radius, np.linspace(0, rng.uniform(0.3, 2), 12)], 1), skin)


def _box(half: NDArray, skin: NDArray) -> Mesh:
    """Return a box with half sides (3,)."""
    faces = []
    for axis in range(3):
        for side in (-1, 1):
            corners = np.zeros((2, 2, 3))
            corners[..., axis] = side * half[axis]
            corners[:, :, (axis + 1) % 3] = side * half[(axis + 1) % 3] * np.array([[-1, 1], [-1, 1]])
            corners[:, :, (axis + 2) % 3] = half[(axis + 2) % 3] * np.array([[-1, -1], [1, 1]])
            faces.append(sheet(corners, skin))
    return join(faces)


@lru_cache
def _photo(name: str) -> NDArray[np.uint8]:
    from skimage import data

    grey_or_colour = cv2.imread(str(Path(data.__file__).parent / name), cv2.IMREAD_COLOR_RGB)
    return np.asarray(grey_or_colour, np.uint8)


def _as_bytes(image: NDArray) -> NDArray[np.uint8]:
    return (image.clip(0, 1) * 255).round().astype(np.uint8)
