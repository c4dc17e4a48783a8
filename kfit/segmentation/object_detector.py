"""Boxes around likely objects, by the single-shot detector that comes with kfit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.fitted import resized
from kfit.segmentation.onnx_network import OnnxNetwork

DETECTOR = Path(__file__).parent / "networks" / "objects_ssd.onnx"
CLASSES = (
    "Bicycle", "Boot", "Laptop", "Person", "Chair", "Cattle", "Desk", "Cat", "Computer mouse", "Computer monitor",
    "Box", "Mug", "Coffee cup", "Stationary bicycle", "Table", "Bottle", "High heels", "Vehicle", "Footwear", "Dog",
    "Book", "Camera", "Car",
)  # fmt: skip
# What TensorFlow's SSD of 300 pixels is trained with.
GRIDS = (19, 10, 5, 3, 2, 1)
LEAST_SCALE, GREATEST_SCALE = 0.2, 0.95
RATIOS = (1.0, 2.0, 1 / 2, 3.0, 1 / 3)
VARIANCES = np.array([10.0, 10.0, 5.0, 5.0])
# Boxes of which nothing is learned: almost all photos have fewer objects, and the score is below that of background.
MOST = 16
LEAST_SCORE = 0.1
# Of boxes that overlap by the first IoU the best is kept; it becomes the mean of those that overlap it by the second,
# weighted by their scores (Gidaris and Komodakis, ICCV 2015).
SAME, AGREEING = 0.6, 0.7


@dataclass(frozen=True)
class Proposals:
    """Boxes of likely objects of any class, best first.

    Attributes:
        boxes: (N, 4) left, top, right, bottom in pixels of the photo, inside it.
        scores: (N, 23) in [0, 1], for each of `CLASSES` the highest score among the merged boxes.
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]


class ObjectDetector:
    """SSD with MobileNetV2, trained on 23 classes of Open Images v4.

    A box (cy, cx, h, w) is coded against its anchor a as ((cy − a_cy)/a_h, (cx − a_cx)/a_w, log h/a_h, log w/a_w) times
    (10, 10, 5, 5); scores are sigmoids of the logits. The input is the photo, stretched to 300 × 300 pixels, RGB in
    [−1, 1].

    It knows mugs, coffee cups, bottles, laptops and cameras. Bowls and cans also get boxes, as its other classes
    resemble them; classes therefore do not matter where overlaps are dropped.

    Source: Liu et al., "SSD: Single Shot MultiBox Detector", ECCV 2016, arXiv:1512.02325; Ahmadyan et al.,
    "Objectron", CVPR 2021, whose detector it is.

    Args:
        path: path of the ONNX file; the bundled one by default.

    Raises:
        ValueError: if the file has another layout.
    """

    def __init__(self, path: str | Path = DETECTOR) -> None:
        self.network = OnnxNetwork(path)
        shapes = {output.name: output.shape[1:] for output in self.network.outputs}
        wanted = {(len(anchors()), 4): "boxes", (len(anchors()), len(CLASSES) + 1): "logits"}
        self._names = {wanted[shape]: name for name, shape in shapes.items() if shape in wanted}
        if len(self._names) != 2 or None in self.network.sides:
            raise ValueError(f"{path} has not the layout of kfit's object detector ({self.network.layout})")

    def __call__(self, image: NDArray[np.float32]) -> Proposals:
        """Find likely objects in a photo (H, W, 3), RGB in [0, 1]."""
        boxes, scores = self._all(image)
        best = scores.max(1)
        likely = np.flatnonzero(best >= LEAST_SCORE)
        corner_and_size = np.concatenate([boxes[likely, :2], boxes[likely, 2:] - boxes[likely, :2]], 1)
        kept: Any = cv2.dnn.NMSBoxes(corner_and_size.tolist(), best[likely].tolist(), LEAST_SCORE, SAME)
        kept = likely[np.asarray(kept, int).reshape(-1)[:MOST]]
        overlap = iou(boxes[kept], boxes)
        highest = [scores[row >= SAME].max(0) for row in overlap]
        mean = [
            np.average(boxes[row >= AGREEING], 0, scores[row >= AGREEING, scores[index].argmax()])
            for index, row in zip(kept, overlap, strict=True)
        ]
        height, width = image.shape[:2]
        limits = np.array([width, height, width, height], np.float64)
        return Proposals(np.array(mean).reshape(-1, 4).clip(0, limits), np.array(highest).reshape(-1, len(CLASSES)))

    def _all(self, image: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """All boxes (A, 4) in pixels of the photo and their scores (A, 23)."""
        height, width = image.shape[:2]
        sides = (self.network.sides[0] or 0, self.network.sides[1] or 0)
        picture = resized(image, sides) * np.float32(2) - np.float32(1)
        coded, logits = self.network.run(picture, [self._names["boxes"], self._names["logits"]])
        anchor = anchors()
        code = coded[0].astype(np.float64) / VARIANCES
        centre = code[:, :2] * anchor[:, 2:] + anchor[:, :2]
        half = np.exp(code[:, 2:].clip(-10, 10)) * anchor[:, 2:] / 2
        top_left, bottom_right = centre - half, centre + half
        boxes = np.stack([top_left[:, 1], top_left[:, 0], bottom_right[:, 1], bottom_right[:, 0]], 1)
        scores = 1 / (1 + np.exp(-logits[0, :, 1:].astype(np.float64).clip(-50, 50)))
        return boxes * (width, height, width, height), scores


@lru_cache
def anchors() -> NDArray[np.float64]:
    """Return the 1917 anchors of an SSD with six grids: (A, 4) cy, cx, h, w in sides of the picture.

    Grid k has scale s_k, from 0.2 to 0.95 in even steps; an anchor of ratio r is s/√r high and s·√r wide. The last of
    six a cell is a square of √(s_k · s_{k+1}). Of the finest grid there are three: 0.1 at ratio 1, 0.2 at 2 and 1/2.
    """
    scales = [*np.linspace(LEAST_SCALE, GREATEST_SCALE, len(GRIDS)).tolist(), 1.0]
    found = []
    for number, grid in enumerate(GRIDS):
        kinds = [(scales[number], ratio) for ratio in RATIOS]
        kinds.append(((scales[number] * scales[number + 1]) ** 0.5, 1.0))
        if number == 0:
            kinds = [(0.1, 1.0), (scales[0], 2.0), (scales[0], 1 / 2)]
        for row, column, (scale, ratio) in product(range(grid), range(grid), kinds):
            found.append(((row + 0.5) / grid, (column + 0.5) / grid, scale / ratio**0.5, scale * ratio**0.5))
    return np.array(found)


def iou(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.float64]:
    """Return the intersection over union (N, M) of boxes (N, 4) and (M, 4), left, top, right, bottom."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    common = (high - low).clip(0).prod(2)
    areas = [(boxes[:, 2:] - boxes[:, :2]).clip(0).prod(1) for boxes in (a, b)]
    return np.asarray(common / np.maximum(areas[0][:, None] + areas[1][None] - common, 1e-12), np.float64)
