"""The photo with the answer drawn over it."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from kfit.pose import PoseResult
from kfit.reports.fit_frames import Picture
from kfit.reports.overlay import draw_overlay


def fitted_photo(result: PoseResult) -> Picture:
    """The photo with box, axes and the outline of the drawing's silhouette."""
    rotation, translation, size, camera = (
        torch.from_numpy(part) for part in (result.rotation, result.translation, result.size, result.intrinsics)
    )
    silhouette = result.draw(result.fit.values).mask
    outlined = None if silhouette is None else _in_photo(silhouette[0, 0].numpy(), result)
    return draw_overlay(result.image, rotation, translation, size, camera, mask=outlined)


def _in_photo(silhouette: NDArray[np.float32], result: PoseResult) -> NDArray[np.float32]:
    height, width = result.image.shape[:2]
    placed: NDArray[np.float32] = cv2.warpAffine(
        silhouette, result.crop.crop_to_image[:2].numpy(), (width, height), flags=cv2.INTER_LINEAR
    )
    return placed
