"""The pose of an object in one frame of a video."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfit.geometry import Crop


@dataclass(frozen=True)
class TrackedPose:
    """The pose of the object in one frame.

    Attributes:
        rotation: (3, 3), object (NOCS axes, y up) to camera (OpenCV: x right, y down, z forward).
        translation: (3,) of the object's centre, in metres, from the category's mean size.
        size: (3,) sides of the object's box, in metres.
        energy: ranking energy of the pose; lower is better.
        overlap: intersection over union of drawing and mask, in [0, 1]; low if tracking is about to fail.
        confidence: probability that the rotation is within 20° of the truth, in [0, 1]; see `kfit.tracking.Tracker`.
        lost: whether overlap or energy show that the pose is not the object's, or no object was found.
        anew: whether the frame was fitted from scratch: the first, and those where the object was lost.
        intrinsics: (3, 3).
        mask: (H, W) that was used.
        crop: the square that was compared.
        drawing: (S, S, 3), the picture that explains it.
        silhouette: (S, S) in [0, 1], above 1/2 where the drawing shows the object.

    Example:
        >>> from kfit.tracking import track
        >>> for pose in track(kfit.load("mug"), frames, mask=first_mask):  # doctest: +SKIP
        ...     print(pose.found, pose.rotation, pose.translation, pose.confidence)
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    size: NDArray[np.float64]
    energy: float
    overlap: float
    confidence: float
    lost: bool
    anew: bool
    intrinsics: NDArray[np.float64] = field(repr=False)
    mask: NDArray[np.float32] = field(repr=False)
    crop: Crop = field(repr=False)
    drawing: NDArray[np.float32] = field(repr=False)
    silhouette: NDArray[np.float32] = field(repr=False)

    @property
    def found(self) -> bool:
        """Whether an object was found and the pose explains it."""
        return not self.lost
