"""The mask of the object in a box, by kfit's own networks."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.grabcut import GrabCut
from kfit.segmentation.onnx_network import OnnxNetwork
from kfit.segmentation.salient_object import U2NET, SalientObject
from kfit.segmentation.segmenter import Box, Segment, Segmenter, clipped

# Where the mask spans less of a box, the box was drawn around more than what stands out in it.
REACH = 0.6


class ObjectMask(Segmenter):
    """Segment by U²-Net, or by GrabCut if U²-Net finds nothing or far less than the box.

    Of 41 objects in photos of others, U²-Net segmented 38 correctly by eye and GrabCut 28.
    """

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        try:
            segment = self.salient(image, category, box)
        except ValueError:
            return GrabCut()(image, category, box)
        if box is None or _reach(segment.mask, box) >= REACH:
            return segment
        try:
            other = GrabCut()(image, category, box)
        except ValueError:
            return segment
        return max(segment, other, key=lambda one: _reach(one.mask, box))

    @cached_property
    def salient(self) -> SalientObject:
        """The bundled U²-Net."""
        return SalientObject(OnnxNetwork(U2NET))


def _reach(mask: NDArray[np.float32], box: Box) -> float:
    """Return the smaller of the fractions of a box's width and height that a mask spans."""
    left, top, right, bottom = clipped(box, mask.shape[1], mask.shape[0])
    _, _, width, height = cv2.boundingRect((mask > 0.5).astype(np.uint8))
    return float(min(width / (right - left), height / (bottom - top)))
