"""Pictures with objects of known pose, from any data set."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# Names of kfit's categories in data sets.
WORDS = {"cup": "mug", "mug": "mug", "bottle": "bottle", "bowl": "bowl", "camera": "camera", "can": "can"}
WORDS |= {"laptop": "laptop"}


@dataclass(frozen=True)
class AnnotatedObject:
    """An object in a picture, with the fields of `kfit.data.NOCSObject`.

    Attributes:
        instance: its number in the picture.
        category: name of its category; kfit's name if kfit has the category.
        pose: (4, 4) of [s R | t], object to camera in metres and OpenCV axes, s the diagonal of the box.
        size: (3,) extents over the diagonal.
        box: (4,) in the picture: top, left, bottom, right, the latter two just outside.
        mask: (H, W); None if the data set has none.
        handle_visible: always True, because only NOCS annotates it.
    """

    instance: int
    category: str
    pose: NDArray[np.float64]
    size: NDArray[np.float64]
    box: NDArray[np.int32]
    mask: NDArray[np.bool_] | None = field(default=None, repr=False)
    handle_visible: bool = True

    @staticmethod
    def of(
        instance: int,
        category: str,
        rotation: NDArray[np.float64],
        translation: NDArray[np.float64],
        size: NDArray[np.float64],
        intrinsics: NDArray[np.float64],
        mask: NDArray[np.bool_] | None = None,
    ) -> AnnotatedObject:
        """Build an object from a rotation (3, 3), and translation and size (3,) in metres.

        Raises:
            ValueError: If the numbers are not the pose of a box in front of the camera.
        """
        diagonal = float(np.linalg.norm(size))
        numbers = [rotation, translation, size]
        right = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
        if not (all(np.isfinite(part).all() for part in numbers) and right and diagonal > 0 and (size >= 0).all()):
            raise ValueError(f"object {instance}, a {category}, has no proper rotation, translation and size")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = diagonal * rotation, translation
        if mask is not None and mask.any():
            rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
            box = np.array([rows[0], columns[0], rows[-1] + 1, columns[-1] + 1], np.int32)
        else:
            signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
            corners = (signs * size) @ rotation.T + translation
            if (corners[:, 2] <= 0).any():
                raise ValueError(f"object {instance}, a {category}, does not lie in front of the camera")
            pixels = corners @ intrinsics.T
            pixels = pixels[:, :2] / pixels[:, 2:]
            low, high = np.floor(pixels.min(0)), np.ceil(pixels.max(0)) + 1
            box = np.array([low[1], low[0], high[1], high[0]]).clip(-(10**6), 10**6).astype(np.int32)
        return AnnotatedObject(instance, category, pose, size / diagonal, box, mask)


@dataclass(frozen=True)
class AnnotatedFrame:
    """A picture and its objects.

    Attributes:
        path: path whose last three parts name the result.
        image: file of the picture.
        intrinsics: (3, 3).
        objects: objects with a known pose.
        depth: file of a 16-bit depth picture, or None.
        depth_unit: metres per step of the depth picture.
    """

    path: Path
    image: Path
    intrinsics: NDArray[np.float64]
    objects: tuple[AnnotatedObject, ...]
    depth: Path | None = None
    depth_unit: float = 0.001
