"""YOLO with prototype masks, as Ultralytics exports it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.classes import COCO
from kfit.segmentation.detections import Detections, Detector
from kfit.segmentation.fitted import Fitted, within
from kfit.segmentation.onnx_network import OnnxNetwork, Socket

# Ultralytics' own: the size of training, the grey of margins, the thresholds of prediction.
SIDE = 640
GREY = (114 / 255, 114 / 255, 114 / 255)
MIN_SCORE, ALIKE = 0.25, 0.7
# Suppression takes the square of the first, masks take memory by the second.
CANDIDATES, MOST = 3000, 100
MOST_PIXELS = 2**21


class YoloSeg(Detector):
    """YOLOv8-seg, YOLO11-seg or YOLO26-seg.

    Two outputs: M prototypes P, (1, M, h, w), and either (1, 4 + classes + M, anchors), an anchor's box (centre, width,
    height), score by class and coefficients c, or (1, anchors, 6 + M) with overlaps suppressed: box (left, top, right,
    bottom), score, class and coefficients. A mask is σ(Σ_m c_m P_m) inside its box. The input is the photo on a grey
    canvas, RGB in [0, 1]. Class names are the file's or, if it has none, COCO's for 80 classes.

    Args:
        network: network with that layout.

    Raises:
        ValueError: if it has another layout.

    Source: Bolya et al., "YOLACT", ICCV 2019, for the prototypes; Ultralytics' guide to end-to-end detection for the
    layouts.
    """

    def __init__(self, network: OnnxNetwork) -> None:
        outputs = _outputs(network)
        if outputs is None:
            raise ValueError(f"{network.path} has not YOLO-seg's layout ({network.layout})")
        self.network = network
        self._outputs = outputs
        found, prototypes = outputs
        self._suppressed = found.shape[2] == 6 + (prototypes.shape[1] or 0)
        count = None if self._suppressed else (found.shape[1] or 0) - 4 - (prototypes.shape[1] or 0)
        unnamed = dict(enumerate(COCO if count in (None, len(COCO)) else [f"class {n}" for n in range(count or 0)]))
        self.names = network.names() or unnamed
        self.classes = list(self.names.values())

    @staticmethod
    def fits(network: OnnxNetwork) -> bool:
        """Whether the outputs have YOLO-seg's shapes."""
        return _outputs(network) is not None

    def detect(self, image: NDArray[np.float32]) -> Detections:
        shape = (image.shape[0], image.shape[1])
        canvas = (self.network.sides[0] or SIDE, self.network.sides[1] or SIDE)
        size = within(shape, canvas)
        place = ((canvas[0] - size[0]) // 2, (canvas[1] - size[1]) // 2)
        fitted = Fitted.on(canvas, image, size, place, GREY)
        found, prototypes = self.network.run(fitted.pixels, [output.name for output in self._outputs])
        if not len(found) == len(prototypes) == 1:
            raise ValueError(f"{self.network.path} answers for {len(found)} pictures, not for one")
        if prototypes[0, 0].size > MOST_PIXELS:
            raise ValueError(
                f"{self.network.path} gave masks of {prototypes.shape[2:]}, more than {MOST_PIXELS:,} pixels"
            )
        extra = prototypes.shape[1]
        boxes, scores, numbers, coefficients = _suppressed(found[0]) if self._suppressed else _suppress(found[0], extra)
        # Interpolated before the σ, as Ultralytics does: σ(x) > 1/2 where x > 0.
        masks = (0.5 + coefficients @ prototypes[0].reshape(extra, -1)).reshape(-1, *prototypes.shape[2:])
        names = [self.names.get(number, f"class {number}") for number in numbers.tolist()]
        frames = np.tile(fitted.frame, (len(names), 1))
        return Detections(shape, fitted.to_photo(boxes), scores.astype(np.float64), names, masks, frames)


def _outputs(network: OnnxNetwork) -> tuple[Socket, Socket] | None:
    """Detections and prototypes, if the network has just these."""
    if sorted(len(output.shape) for output in network.outputs) != [3, 4]:
        return None
    found, prototypes = sorted(network.outputs, key=lambda output: len(output.shape))
    rows, columns, extra = found.shape[1], found.shape[2], prototypes.shape[1]
    if extra is None or any(output.shape[0] not in (1, None) or not output.is_float for output in network.outputs):
        return None
    if columns == 6 + extra:
        return found, prototypes
    # YOLOv5 has the axes in reversed order, and a separate score for "object".
    if rows is None or rows < 5 + extra or (columns is not None and columns < rows):
        return None
    return found, prototypes


def _suppressed(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.int_], NDArray[Any]]:
    rows = rows[np.isfinite(rows).all(1) & (rows[:, 4] >= MIN_SCORE)]
    rows = rows[np.argsort(-rows[:, 4], kind="stable")[:MOST]]
    return rows[:, :4], rows[:, 4], rows[:, 5].astype(int), rows[:, 6:]


def _suppress(found: NDArray[Any], extra: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.int_], NDArray[Any]]:
    """Return boxes, scores, classes and coefficients of anchors that no better one of their class overlaps."""
    rows = found.T
    score = rows[:, 4:-extra].max(1)
    likely = np.flatnonzero(np.isfinite(rows).all(1) & (score >= MIN_SCORE))
    likely = likely[np.argsort(-score[likely], kind="stable")[:CANDIDATES]]
    rows, score = rows[likely], score[likely]
    numbers = rows[:, 4:-extra].argmax(1)
    half = rows[:, 2:4] / 2
    boxes = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], 1)
    corner_and_size = np.concatenate([boxes[:, :2], rows[:, 2:4]], 1).astype(float)
    kept: Any = []
    if len(rows):
        kept = cv2.dnn.NMSBoxesBatched(corner_and_size.tolist(), score.tolist(), numbers.tolist(), 0.0, ALIKE)
    kept = np.asarray(kept, int).reshape(-1)[:MOST]
    return boxes[kept], score[kept], numbers[kept], rows[kept, -extra:]
