"""Segmenters of strangers: wrong types, wrong shapes, endless loops and huge outputs get a sentence."""

from __future__ import annotations

import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from onnx_files import is_net, scene, write

from kfit.segmentation import load_segmenter, onnx_network

FLOAT, BOOL, INT64, TEXT = TensorProto.FLOAT, TensorProto.BOOL, TensorProto.INT64, TensorProto.STRING
VALUES = {BOOL: True, TEXT: "x", INT64: 1, TensorProto.UINT8: 1}


def save(path: Path, nodes: list[Any], kind: int, shape: list[Any], name: str = "mask") -> Path:
    """A network of a picture of 1024 x 1024 pixels with one output."""
    ends = [
        helper.make_tensor_value_info("image", FLOAT, [1, 3, 1024, 1024]),
        helper.make_tensor_value_info(name, kind, shape),
    ]
    graph = helper.make_graph(nodes, "hostile", ends[:1], ends[1:])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10), path)
    return path


def constant(name: str, kind: int, shape: list[int], values: list[Any]) -> Any:
    return helper.make_node("Constant", [], [name], value=helper.make_tensor(name, kind, shape, values))


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.parametrize("shape", [[1, 1, 2, 2], [4]])
def test_an_output_that_is_no_float_makes_no_segmenter(kind: int, shape: list[int], tmp_path: Path) -> None:
    path = save(tmp_path / "a.onnx", [constant("mask", kind, shape, [VALUES[kind]] * 4)], kind, shape)
    with pytest.raises(ValueError, match=r"a\.onnx has the layout of neither"):
        load_segmenter(path)


def test_an_output_of_another_shape_than_the_file_says_is_refused(tmp_path: Path) -> None:
    size = constant("size", INT64, [4], [1, 1, 8, 8])
    least = helper.make_node("ReduceMin", ["image"], ["least"], keepdims=0)
    expand = helper.make_node("Expand", ["least", "size"], ["mask"])
    for shape in ([1, 1, 4, 4], [1, 1, "h", 4]):
        path = save(tmp_path / "a.onnx", [size, least, expand], FLOAT, shape)
        with pytest.raises(ValueError, match=r"a\.onnx") as error:
            load_segmenter(path)(scene()[0], "mug")
        assert "\n" not in str(error.value)


def test_an_endless_loop_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = helper.make_graph(
        [helper.make_node("Identity", ["on"], ["still"]), helper.make_node("Identity", ["a"], ["b"])],
        "body",
        [
            helper.make_tensor_value_info("turn", INT64, []),
            helper.make_tensor_value_info("on", BOOL, []),
            helper.make_tensor_value_info("a", FLOAT, None),
        ],
        [helper.make_tensor_value_info("still", BOOL, []), helper.make_tensor_value_info("b", FLOAT, None)],
    )
    nodes = [
        constant("yes", BOOL, [], [True]),
        helper.make_node("ReduceMax", ["image"], ["one"], keepdims=1),
        helper.make_node("Loop", ["", "yes", "one"], ["mask"], body=body),
    ]
    segmenter = load_segmenter(save(tmp_path / "a.onnx", nodes, FLOAT, [1, 1, 1, 1]))
    monkeypatch.setattr(onnx_network, "LONGEST_RUN", 0.5)
    begun = time.monotonic()
    with pytest.raises(ValueError, match=r"a\.onnx takes more than 0\.5 seconds for a picture of 1024 x 1024 pixels"):
        segmenter(scene()[0], "mug")
    assert time.monotonic() - begun < 60


def test_a_huge_output_takes_no_memory(tmp_path: Path) -> None:
    nodes = [
        constant("size", INT64, [4], [1, 1, 40_000, 40_000]),
        helper.make_node("ReduceMax", ["image"], ["most"], keepdims=0),
        helper.make_node("Expand", ["most", "size"], ["mask"]),
    ]
    segmenter = load_segmenter(save(tmp_path / "a.onnx", nodes, FLOAT, [1, 1, "h", "w"]))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"a\.onnx fails on a picture of 1024 x 1024 pixels"):
        segmenter(scene()[0], "mug")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_000_000


def test_huge_prototypes_are_refused_before_masks_are_made(tmp_path: Path) -> None:
    found = np.zeros((1, 10, 100), np.float32)
    found[0, :, 0] = [30, 30, 20, 20, 0.9, 0, 0, 1, 1, 1]
    path = write(
        tmp_path / "a.onnx",
        [("Resize", ["image", "", "", "sizes"], "prototypes", {"mode": "nearest"})],
        [1, 3, 64, 64],
        {"found": [1, 10, "n"], "prototypes": [1, 3, "h", "w"]},
        {"found_": found, "sizes": np.array([1, 3, 1600, 1600])},
    )
    with pytest.raises(ValueError, match=r"gave masks of \(1600, 1600\), more than 2,097,152 pixels"):
        load_segmenter(path)(scene()[0], "mug", (10, 10, 50, 50))


def test_a_good_network_still_answers(tmp_path: Path) -> None:
    assert load_segmenter(is_net(tmp_path / "a.onnx"))(scene()[0], "mug").mask.any()
