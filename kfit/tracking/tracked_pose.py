"""Where an object is in one frame of a video."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfit.geometry import Crop


@dataclass(frozen=True)
class TrackedPose:
    """Where the object is in one frame.

    Attributes:
        rotation: (3, 3), object (NOCS axes, y up) to camera (OpenCV: x right, y down, z forward).
        translation: (3,) of the object's centre, in metres, by the category's mean size.
        size: (3,) sides of the object's box, in metres.
        energy: by which the pose was chosen; lower is better.
        overlap: intersection over union of drawing and mask, in [0, 1]; low where the object is about to be lost.
        confidence: that the rotation is within 20° of the truth, in [0, 1]; see `kfit.tracking.Tracker`.
        lost: whether overlap or energy show that the pose is not the object's, or nothing was seen of it.
        anew: whether the frame was fitted from nothing: the first, and those where the object was lost.
        intrinsics: (3, 3).
        mask: (H, W) that was used.
        crop: the square that was compared.
        drawing: (S, S, 3), the picture that explains it.
        silhouette: (S, S) in [0, 1], above 1/2 where the drawing shows the object.
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
        """Whether the object was seen, and the pose explains it."""
        return not self.lost
