"""Mask R-CNN, as the ONNX model zoo publishes it and as torchvision exports it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.classes import COCO, COCO_BY_OWN_NUMBER
from kfit.segmentation.detections import Detections, Detector
from kfit.segmentation.fitted import Fitted, within
from kfit.segmentation.onnx_network import OnnxNetwork, Socket

PARTS = ("boxes", "labels", "scores", "masks")
# The zoo's: a patch of mask a box, the shorter and longer side of its pictures, multiples of the backbone's stride,
# and the mean that is taken off blue, green and red of 0 … 255.
PATCH = (28, 28)
SHORT, LONG, STRIDE = 800, 1333, 32
MEAN_BGR = (102.9801, 115.9465, 122.7717)
MIN_SCORE, MOST = 0.25, 100


class MaskRCNN(Detector):
    """Mask R-CNN with outputs boxes (N, 4), labels (N,), scores (N,) and masks.

    Masks (N, 1, 28, 28), one patch a box, are the ONNX model zoo's: the photo goes in as BGR less its mean with a
    shorter side of 800, and labels count COCO's 80 classes from 1. Masks (N, 1, H, W) of the whole picture are
    torchvision's: RGB in [0, 1] with a longer side of at most 1333, and COCO's own labels from 1 to 90. Labels of other
    classes are in a dict ``names`` in the file's metadata.

    Args:
        network: network with that layout.

    Raises:
        ValueError: if it has another layout.

    Source: He et al., "Mask R-CNN", ICCV 2017; onnx/models@003c28a6757a, mask-rcnn/README.md, for the zoo's layout.
    """

    def __init__(self, network: OnnxNetwork) -> None:
        parts = _parts(network)
        if parts is None:
            raise ValueError(f"{network.path} has not Mask R-CNN's layout ({network.layout})")
        self.network = network
        self._parts = parts
        self._patches = parts["masks"].shape[-2:] == PATCH
        counted = dict(enumerate(COCO, 1)) if self._patches else COCO_BY_OWN_NUMBER
        self.names = network.names() or counted
        self.classes = list(self.names.values())

    @staticmethod
    def fits(network: OnnxNetwork) -> bool:
        """Return whether the outputs have Mask R-CNN's shapes."""
        return _parts(network) is not None

    def detect(self, image: NDArray[np.float32]) -> Detections:
        shape = (image.shape[0], image.shape[1])
        fitted = self._fitted(image, shape)
        pixels = fitted.pixels
        if self._patches:
            pixels = 255 * pixels[..., ::-1] - np.array(MEAN_BGR, np.float32)
        boxes, labels, scores, masks = self.network.run(pixels, [self._parts[name].name for name in PARTS])
        size = PATCH if self._patches else pixels.shape[:2]
        if masks.shape[1:] != (1, *size) or not len(boxes) == len(labels) == len(scores) == len(masks):
            raise ValueError(
                f"{self.network.path} gave {len(boxes)} boxes and masks of shape {masks.shape}, expected "
                f"({len(boxes)}, 1, {size[0]}, {size[1]})"
            )
        likely = np.flatnonzero((scores >= MIN_SCORE) & np.isfinite(boxes).all(1))
        likely = likely[np.argsort(-scores[likely], kind="stable")[:MOST]]
        placed = fitted.to_photo(boxes[likely])
        keep = (placed[:, 2:] > placed[:, :2]).all(1)
        likely, placed = likely[keep], placed[keep]
        names = [self.names.get(int(label), f"class {int(label)}") for label in labels[likely]]
        frames = placed if self._patches else np.tile(fitted.frame, (len(likely), 1))
        return Detections(shape, placed, scores[likely].astype(np.float64), names, masks[likely, 0], frames)

    def _fitted(self, image: NDArray[np.float32], shape: tuple[int, int]) -> Fitted:
        height, width = self.network.sides
        blue, green, red = MEAN_BGR
        # The zoo's margin is 0 after the mean is taken off.
        margin = (red / 255, green / 255, blue / 255) if self._patches else (0.0, 0.0, 0.0)
        if height is not None and width is not None:
            return Fitted.on((height, width), image, within(shape, (height, width)), margin=margin)
        if not self._patches:
            # torchvision's export scales its input, but its masks have the size of the input.
            size = within(shape, (LONG, LONG)) if max(shape) > LONG else shape
            return Fitted.on(size, image, size)
        scale = min(SHORT / min(shape), LONG / max(shape))
        size = (max(1, round(scale * shape[0])), max(1, round(scale * shape[1])))
        canvas = (math.ceil(size[0] / STRIDE) * STRIDE, math.ceil(size[1] / STRIDE) * STRIDE)
        return Fitted.on(canvas, image, size, margin=margin)


def _parts(network: OnnxNetwork) -> dict[str, Socket] | None:
    """Identify the four outputs by their shapes and types; None if they are not these."""
    found: dict[str, Socket] = {}
    for output in network.outputs:
        rank, whole = len(output.shape), output.kind.startswith("int")
        if rank == 2 and output.shape[1] in (4, None) and output.is_float:
            found["boxes"] = output
        elif rank == 1 and (whole or output.is_float):
            found["labels" if whole else "scores"] = output
        elif rank == 4 and output.shape[1] in (1, None) and output.is_float:
            found["masks"] = output
    return found if len(found) == len(network.outputs) == len(PARTS) else None
