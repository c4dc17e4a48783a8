"""Tiny ONNX files in the layouts of published segmenters, whose masks are what is bluer than red in the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

Shape = list[Any]


def scene(width: int = 200, height: int = 150) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """A blue disc on noisy ochre ground, and its mask."""
    rng = np.random.default_rng(0)
    image = np.full((height, width, 3), (0.7, 0.5, 0.2)) + rng.normal(0, 0.05, (height, width, 3))
    disc = np.zeros((height, width), np.uint8)
    cv2.circle(disc, (90, 70), 35, 1, -1)
    image[disc > 0] = (0.1, 0.2, 0.8)
    return image.clip(0, 1).astype(np.float32), disc


DISC_BOX = (55.0, 35.0, 126.0, 106.0)  # left, top, right, bottom of the disc, the latter two exclusive
OTHER_BOX = (140.0, 20.0, 190.0, 60.0)


def overlap(a: NDArray[Any], b: NDArray[Any]) -> float:
    return float(((a > 0) & (b > 0)).sum() / ((a > 0) | (b > 0)).sum())


def write(
    path: Path,
    nodes: list[tuple[str, list[str], str, dict[str, Any]]],
    picture: Shape,
    outputs: dict[str, Shape | None],
    constants: dict[str, NDArray[Any]],
    names: str | None = None,
) -> Path:
    """A file of nodes (operation, inputs, output, attributes); outputs that are constants are copied out."""
    made = [helper.make_node(kind, sources, [target], **how) for kind, sources, target, how in nodes]
    made += [helper.make_node("Identity", [f"{name}_"], [name]) for name in outputs if f"{name}_" in constants]
    kinds = {name: TensorProto.INT64 if "labels" in name or name == "6570" else TensorProto.FLOAT for name in outputs}
    graph = helper.make_graph(
        made,
        "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, picture)],
        [helper.make_tensor_value_info(name, kinds[name], shape) for name, shape in outputs.items()],
        [numpy_helper.from_array(array, name) for name, array in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    if names is not None:
        helper.set_model_props(model, {"names": names, "task": "segment"})
    onnx.save(model, path)
    return path


def yolo(
    path: Path,
    names: str | None = "{0: 'person', 1: 'cup', 2: 'bottle'}",
    suppressed: bool = False,
    picture: Shape | None = None,
    num_classes: int = 3,
) -> Path:
    """YOLO-seg of 64 x 64 pixels: a cup on the disc, found twice, and elsewhere a bottle and a cup less sure."""
    # The photo of 200 x 150 goes in at a scale of 0.32, 8 rows down.
    boxes = [np.array(box) * 0.32 + (0, 8, 0, 8) for box in (DISC_BOX, DISC_BOX, OTHER_BOX, OTHER_BOX)]
    classes, scores, coefficients = [1, 1, 2, 1], [0.9, 0.8, 0.6, 0.4], np.array([-20.0, 0, 20])
    found = np.zeros((1, 20, 9) if suppressed else (1, 4 + num_classes + 3, 100), np.float32)
    for row, (box, number, score) in enumerate(zip(boxes, classes, scores, strict=True)):
        if suppressed:
            found[0, row] = [*box, score, number, *coefficients]
        else:
            found[0, :4, row] = [*(box[:2] + box[2:]) / 2, *(box[2:] - box[:2])]
            found[0, 4 + number, row], found[0, -3:, row] = score, coefficients
    if suppressed:
        found[0, 1, 4] = 0
    return write(
        path,
        [("AveragePool", ["image"], "output1", {"kernel_shape": [2, 2], "strides": [2, 2]})],
        picture or [1, 3, 64, 64],
        {"output0": list(found.shape), "output1": None},
        {"output0_": found},
        names,
    )


def mask_rcnn(path: Path, names: str | None = None, scale: float = 1.0) -> Path:
    """torchvision's layout: masks of the whole picture; 47 is COCO's own number for a cup, 44 for a bottle."""
    boxes = np.array([DISC_BOX, OTHER_BOX, (5, 5, 5, 9)], np.float32) * scale
    return write(
        path,
        [
            ("Gather", ["image", "two"], "blue", {"axis": 0}),
            ("Gather", ["image", "zero"], "red", {"axis": 0}),
            ("Sub", ["blue", "red"], "bluer", {}),
            ("Mul", ["bluer", "twenty"], "logits", {}),
            ("Sigmoid", ["logits"], "one_mask", {}),
            ("Unsqueeze", ["one_mask", "zero"], "mask", {}),
            ("Concat", ["mask", "mask", "mask"], "masks", {"axis": 0}),
        ],
        [3, "height", "width"],
        {"boxes": ["n", 4], "labels": ["n"], "scores": ["n"], "masks": ["n", 1, "height", "width"]},
        {
            "boxes_": boxes,
            "labels_": np.array([47, 44, 47]),
            "scores_": np.array([0.9, 0.6, 0.95], np.float32),
            "zero": np.array([0]),
            "two": np.array([2]),
            "twenty": np.array([20], np.float32),
        },
        names,
    )


def zoo_mask_rcnn(path: Path) -> Path:
    """The ONNX model zoo's layout: patches; 42 is COCO's 42nd class, a cup."""
    away = np.linspace(-13.5, 13.5, 28)
    patch = (away[:, None] ** 2 + away**2 < 14**2).astype(np.float32)
    return write(
        path,
        [],
        [3, "height", "width"],
        {"6568": ["n", 4], "6570": ["n"], "6572": ["n"], "6887": ["n", 1, 28, 28]},
        {
            "6568_": np.array([DISC_BOX, OTHER_BOX], np.float32) * np.float32(800 / 150),
            "6570_": np.array([42, 40]),
            "6572_": np.array([0.9, 0.1], np.float32),
            "6887_": np.stack([patch, patch])[:, None],
        },
    )


def is_net(path: Path, side: int = 1024, gain: float = 1.0) -> Path:
    """IS-Net's layout: a mask in [0, 1], and features."""
    return write(
        path,
        [
            ("Gather", ["image", "two"], "blue", {"axis": 1}),
            ("Gather", ["image", "zero"], "red", {"axis": 1}),
            ("Sub", ["blue", "red"], "bluer", {}),
            ("Mul", ["bluer", "twenty"], "logits", {}),
            ("Sigmoid", ["logits"], "mask", {}),
            ("Mul", ["mask", "gain"], "output", {}),
            ("MaxPool", ["image"], "features", {"kernel_shape": [2, 2], "strides": [2, 2]}),
        ],
        [1, 3, side, side],
        {"output": None, "features": None},
        {
            "zero": np.array([0]),
            "two": np.array([2]),
            "twenty": np.array([20], np.float32),
            "gain": np.array([gain], np.float32),
        },
    )
