"""The salient object in a box, by a network."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.fitted import resized
from kfit.segmentation.largest_part import largest_part
from kfit.segmentation.onnx_network import OnnxNetwork
from kfit.segmentation.segmenter import WHOLE_PICTURE, Box, Segment, Segmenter, clipped, spell

U2NET = Path(__file__).parent / "networks" / "u2netp.onnx"
# Sides of the picture where the file leaves them open.
SIDE = 1024
# U²-Net and its relatives are trained on pictures of 320 pixels, IS-Net and its relatives on 1024.
LARGEST_U2NET = 512
# Where nothing stands out all of U²-Net's numbers are low: 0.001 on grey, 0.2 to 0.3 on grass and gravel, 1 on objects.
LEAST_CONTRAST = 0.4
MEAN, STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)
# On 12 objects of NOCS and D435 frames with tight boxes, IS-Net's median IoU is 0.94 (a square around the box and its
# tenth: 0.93, the box's square alone: 0.94) where GrabCut reaches 0.98; on the one GrabCut mistakes, 0.78 for its 0.55.
SURROUND = 0.25
# Enlarged masks follow edges of the photo within this many of the network's pixels, where those differ by more than the
# root of the second in colour (He et al., "Guided image filtering", ECCV 2010).
EDGE_RADIUS, EDGE_VARIANCE = 1.5, 1e-4


class SalientObject(Segmenter):
    """Segment by U²-Net or IS-Net on a box enlarged by a quarter, or on the whole picture.

    The network's first output is a mask (1, 1, h, w) in [0, 1] of saliency. The largest connected part inside of
    the box is kept, and holes under 1 % of it are filled. A mask with fewer pixels than the photo is
    fitted to the photo's edges by a guided filter. It knows no categories.

    The input size distinguishes the two. Up to 512 pixels it is U²-Net: RGB is normalised by ImageNet's mean and
    deviation, and the mask is stretched from its minimum to its maximum. Larger or free sizes are IS-Net's: RGB − 1/2.

    Args:
        network: network with that layout.

    Raises:
        ValueError: if it has another layout.

    Source: Qin et al., "U²-Net: Going deeper with nested U-structure for salient object detection", Pattern
    Recognition 2020; Qin et al., "Highly accurate dichotomous image segmentation", ECCV 2022.
    """

    def __init__(self, network: OnnxNetwork) -> None:
        if not self.fits(network):
            raise ValueError(f"{network.path} has the layout of neither U²-Net nor IS-Net ({network.layout})")
        self.network = network
        self.sides = (network.sides[0] or SIDE, network.sides[1] or SIDE)

    @staticmethod
    def fits(network: OnnxNetwork) -> bool:
        """Whether one picture goes in and the first output is one mask."""
        first = network.outputs[0]
        one_mask = len(first.shape) == 4 and first.shape[:2] in ((1, 1), (None, 1))
        return one_mask and first.is_float and not network.channels_last

    def __call__(self, image: NDArray[np.float32], category: str, box: Box | None = None) -> Segment:
        height, width = image.shape[:2]
        left, top, right, bottom = (0, 0, width, height) if box is None else clipped(box, width, height)
        across, down = round(SURROUND * (right - left)), round(SURROUND * (bottom - top))
        x0, x1 = max(0, left - across), min(width, right + across)
        y0, y1 = max(0, top - down), min(height, bottom + down)
        mask = np.zeros((height, width), np.float32)
        mask[y0:y1, x0:x1] = self.saliency(image[y0:y1, x0:x1]) > 0.5
        inside = np.zeros_like(mask)
        inside[top:bottom, left:right] = mask[top:bottom, left:right]
        if not inside.any():
            raise ValueError(
                "no object found in " + ("the picture" if box is None else f"box {spell(box)}") + ": nothing stands out"
            )
        return Segment(largest_part(inside).astype(np.float32), (WHOLE_PICTURE,) if box is None else ())

    def saliency(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the saliency (H, W) in [0, 1] of a picture (H, W, 3), RGB in [0, 1].

        Raises:
            ValueError: if the network's output is not such a mask.
        """
        is_u2net = max(self.sides) <= LARGEST_U2NET
        picture = resized(image, self.sides)
        picture = (picture - MEAN) / STD if is_u2net else picture - np.float32(0.5)
        answer = self.network.run(picture, [self.network.outputs[0].name])[0]
        if answer.shape[:2] != (1, 1) or answer.size == 0:
            raise ValueError(f"{self.network.path} gave a mask of shape {answer.shape}, expected (1, 1, h, w)")
        found = np.asarray(answer[0, 0], np.float32)
        low, high = float(found.min()), float(found.max())
        if not (low >= -0.01 and high <= 1.01):
            raise ValueError(f"{self.network.path} gave numbers from {low:.2f} to {high:.2f}, not a mask in [0, 1]")
        if is_u2net and high - low > LEAST_CONTRAST:
            found = (found - low) / (high - low)
        large = resized(found, (image.shape[0], image.shape[1]))
        enlarged = max(image.shape[0] / found.shape[0], image.shape[1] / found.shape[1])
        if enlarged <= 1:
            return large
        guide = np.ascontiguousarray(image, np.float32)
        refined = cv2.ximgproc.guidedFilter(guide, large, math.ceil(EDGE_RADIUS * enlarged), EDGE_VARIANCE)
        return np.asarray(refined, np.float32)
