"""Cameras that see held-out objects: upright and centred, hand-held before a table, or from anywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]
from torch import Tensor

from kfit.data.rasterizer import standard_intrinsics
from kfit.geometry import rotation_from_angles, to_opencv, viewing_ray, viewing_ray_rotation
from kfit.pose import Card

ViewsOf = Literal["upright", "table", "any"]
"""How objects are seen, see `sample_view`."""
# The photo of table and any views: 640 × 480 pixels that see 57° across, as common depth cameras do.
WIDTH, HEIGHT, FOCAL = 640, 480, 590.0
METRES = (0.4, 1.2)
# Degrees: what a person in front of a table sees, and how far a hand-held camera is rolled.
TABLE_ELEVATION, HAND_ROLL = (10.0, 70.0), 7.0
# No camera comes nearer than this many diagonals, so that wide objects stay inside the photo.
NEAREST = 1.4


@dataclass(frozen=True)
class ViewCamera:
    """A pinhole camera and the object that it sees.

    Attributes:
        rotation: (3, 3) of the object relative to its viewing ray, in the generator's y-up frame.
        translation: (3,) of the object's centre in OpenCV axes, in diagonals.
        intrinsics: (3, 3) of the photo, or of the part of it that is drawn.
        size: height and width of what is drawn, in pixels.
    """

    rotation: Tensor
    translation: Tensor
    intrinsics: NDArray[np.float64]
    size: tuple[int, int]

    @property
    def world2cam(self) -> NDArray[np.float64]:
        """(4, 4) map from the object's frame, in diagonals, to the rasterizer's camera (y up)."""
        pixel = torch.from_numpy(self.intrinsics) @ self.translation
        turn = viewing_ray_rotation(pixel[:2] / pixel[2], torch.from_numpy(self.intrinsics))
        pose = torch.eye(4, dtype=torch.float64)
        # y-up is diag(1, −1, −1) times OpenCV.
        pose[:3, :3] = to_opencv(turn @ to_opencv(self.rotation))
        pose[:3, 3] = self.translation * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
        return pose.numpy()


def sample_view(
    views_of: ViewsOf, card: Card, diagonal: float, photo_size: int, rng: np.random.Generator
) -> ViewCamera:
    """Draw a camera.

    - ``upright``: azimuths over the circle, elevations over the card's range, roll 0, the object in the middle of the
      picture, at the model's training distance.
    - ``table``: elevations from 10° to 70°, rolls normal with a deviation of 7°, the object anywhere in a photo of
      640 × 480 pixels, 0.4 to 1.2 m away.
    - ``any``: the same photo, rotations uniform over all.

    Of a photo, the part around the object is drawn; its intrinsics are those of the part.

    Args:
        views_of: how the object is seen.
        card: card of the model.
        diagonal: diagonal of the object, in metres.
        photo_size: side in pixels of an upright view.
        rng: random numbers.
    """
    if views_of == "upright":
        azimuth, elevation = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(*card.elevation_deg))
        camera = standard_intrinsics(photo_size, card.distance, card.unit_fraction)
        place = torch.tensor([0.0, 0.0, card.distance], dtype=torch.float64)
        return ViewCamera(_rotation(azimuth, elevation, 0.0), place, camera, (photo_size, photo_size))
    if views_of == "table":
        angles = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(*TABLE_ELEVATION))
        rotation = _rotation(*angles, math.radians(rng.normal(0, HAND_ROLL)))
    else:
        rotation = torch.from_numpy(Rotation.random(rng=rng).as_matrix())
    distance = max(rng.uniform(*METRES) / diagonal, NEAREST)
    camera = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
    # Half the silhouette of the bounding sphere in pixels, with a margin for what stretches off the axis.
    radius = 1.3 * FOCAL / 2 / math.sqrt(distance**2 - 0.25)
    spans = [max(0.0, side / 2 - radius) for side in (WIDTH, HEIGHT)]
    pixel = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) + rng.uniform(-1, 1, 2) * spans
    place = distance * viewing_ray(torch.from_numpy(pixel), torch.from_numpy(camera))
    corner = np.floor(pixel - radius)
    camera[:2, 2] -= corner
    side = math.ceil(2 * radius)
    return ViewCamera(rotation, place, camera, (side, side))


def _rotation(azimuth: float, elevation: float, roll: float) -> Tensor:
    return rotation_from_angles(*torch.tensor([azimuth, elevation, roll], dtype=torch.float64))
