"""Short videos of objects that kfit draws, moving before photos, with their true poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments
from kfit.data import build, render
from kfit.geometry import rotation_from_angles, to_opencv
from kfit.pose.category_model import CategoryModel

# What stands behind, of scikit-image's pictures.
GROUNDS = ("rocket", "coffee", "chelsea", "astronaut")
HEIGHT, WIDTH = 240, 320
FOCAL = 1.2 * WIDTH
NOISE = 0.01


@dataclass(frozen=True)
class Clip:
    """Frames and the truth.

    Attributes:
        frames: T pictures (H, W, 3) in [0, 1].
        masks: T of them, (H, W) in [0, 1].
        rotation: (T, 3, 3) object to camera, OpenCV axes.
        intrinsics: (3, 3).
    """

    frames: list[NDArray[np.float32]]
    masks: list[NDArray[np.float32]]
    rotation: torch.Tensor
    intrinsics: NDArray[np.float64]


def held_out_clip(
    model: CategoryModel, number: int, num_frames: int = 40, turn_deg: float = 2.0, seed: int = 0
) -> Clip:
    """Draw an object of held-out families that turns and wanders before one of scikit-image's photos, which moves too.

    Azimuth grows or falls evenly; elevation (± 12°), roll (± 5°), place and distance swing, each at a pace of its own;
    pixels have noise of a hundredth.

    Args:
        model: whose category is drawn.
        number: number of the object and its ground.
        num_frames: T.
        turn_deg: change of azimuth from frame to frame.
        seed: chooses objects and poses, with ``number``.

    Raises:
        ValueError: for less than one frame.
    """
    from skimage import data

    check_arguments(held_out_clip, locals(), number=(0,), seed=(0,))
    mesh, light = build(model.card.known, 1_000_000 + 1_000 * seed + number, held_out=True)
    rng = np.random.default_rng([seed, number])
    camera = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
    picture = getattr(data, GROUNDS[number % len(GROUNDS)])()
    behind = cv2.resize(picture, (int(1.3 * WIDTH), int(1.3 * HEIGHT)), interpolation=cv2.INTER_AREA) / 255
    start, low = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(10, 45))
    pace = math.radians(turn_deg) * rng.choice([-1, 1])
    frames, masks, rotations = [], [], []
    for time in range(num_frames):
        swing = {length: math.sin(2 * math.pi * time / length) for length in (35, 40, 45, 50, 60)}
        angles = (start + pace * time, low + math.radians(12) * swing[60], math.radians(5) * swing[40])
        rotation = rotation_from_angles(*(torch.tensor(angle, dtype=torch.float64) for angle in angles))
        pose = np.eye(4)
        pose[:3, :3] = rotation.numpy()
        pose[:3, 3] = 0.25 * swing[45], 0.15 * swing[35], -(3.2 + 0.5 * swing[50])
        view = render(mesh, pose, camera, (HEIGHT, WIDTH), light, 2)
        left, top = int(20 + 15 * math.sin(time / 20)), int(20 + 10 * math.cos(time / 20))
        ground = (1 - view.mask[..., None]) * (behind[top : top + HEIGHT, left : left + WIDTH] - 1)
        noisy = view.image + ground + rng.normal(0, NOISE, view.image.shape)
        frames.append(np.clip(noisy, 0, 1).astype(np.float32))
        masks.append(view.mask.astype(np.float32))
        rotations.append(to_opencv(rotation[None])[0])
    return Clip(frames, masks, torch.stack(rotations), camera)
