"""Draws the app's rendered examples, objects on a table: python docs/drawings/app_examples.py [FOLDER]."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from skimage.io import imsave

from kfit.data import build, render
from kfit.data.rasterizer import standard_pose

# Held out of training: name of the category, seed, elevation and azimuth in degrees, and the table's colour.
OBJECTS = [("laptop", 11, 28, -62, "#b9a58c"), ("camera", 3, 24, -50, "#8d9aa5"), ("bottle", 2, 24, 0, "#a7b09a")]
WIDTH, HEIGHT, FOCAL, DISTANCE, SUN = 720, 540, 900.0, 2.4, np.array([-0.55, 1.0, 0.35])


def scene(category: str, seed: int, elevation: float, azimuth: float, table: str) -> tuple[np.ndarray, np.ndarray]:
    """The picture (H, W, 3) and the mask (H, W) of the object, bytes."""
    mesh, light = build(category, seed, held_out=True)
    pose = standard_pose(np.deg2rad(elevation), np.deg2rad(azimuth), DISTANCE)
    camera = np.array([[FOCAL, 0, WIDTH / 2 - 0.5], [0, FOCAL, HEIGHT / 2 - 0.5], [0, 0, 1]])
    view = render(mesh, pose, camera, (HEIGHT, WIDTH), light, 2)
    ground = mesh.vertices[:, 1].min()
    fall = (mesh.vertices[:, 1] - ground)[:, None]
    flat = mesh.vertices - fall * (pose[:3, :3].T @ SUN / (pose[:3, :3].T @ SUN)[1])
    flat[:, 1] = ground
    shadow = render(replace(mesh, vertices=flat.astype(np.float32)), pose, camera, (HEIGHT, WIDTH), light, 1).mask
    shade = 0.6 * cv2.GaussianBlur(shadow, (0, 0), 9) + 0.4 * cv2.GaussianBlur(shadow, (0, 0), 2)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    falloff = 1.12 - 0.42 * np.hypot((columns / WIDTH - 0.35) * 1.1, rows / HEIGHT - 0.25)
    grain = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH)), (0, 0), 1) * 0.02
    color = np.array([int(table[at : at + 2], 16) / 255 for at in (1, 3, 5)])
    ground_light = (falloff + grain)[..., None] * color * (1 - 0.55 * shade)[..., None]
    picture = view.image - (1 - view.mask[..., None]) + (1 - view.mask[..., None]) * ground_light
    return tuple((255 * part.clip(0, 1)).round().astype(np.uint8) for part in (picture, view.mask))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit/app/examples")
    for category, *settings in OBJECTS:
        picture, mask = scene(category, *settings)
        Image.fromarray(picture).save(folder / f"{category}.jpg", quality=88)
        imsave(folder / f"{category}_mask.png", 255 * (mask > 127).astype(np.uint8), check_contrast=False)
