from pathlib import Path

import numpy as np
import pytest
from onnx_files import is_net, mask_rcnn, scene, write, yolo

from kfit.segmentation import MaskRCNN, OnnxNetwork, SalientObject, YoloSeg, load_segmenter, onnx_network

ONES = np.ones((1, 1000), np.float32)


def test_each_layout_is_recognised_by_its_shapes_whatever_the_names(tmp_path: Path) -> None:
    assert isinstance(load_segmenter(yolo(tmp_path / "a.onnx")), YoloSeg)
    assert isinstance(load_segmenter(mask_rcnn(tmp_path / "b.onnx")), MaskRCNN)
    assert isinstance(load_segmenter(str(is_net(tmp_path / "c.onnx"))), SalientObject)


def test_another_layout_gets_a_sentence_on_what_was_found(tmp_path: Path) -> None:
    path = write(tmp_path / "a.onnx", [], [1, 3, 224, 224], {"logits": [1, 1000]}, {"logits_": ONES})
    with pytest.raises(
        ValueError, match=r"a\.onnx has the layout of neither Mask R-CNN, YOLO-seg, U²-Net nor IS-Net"
    ) as raised:
        load_segmenter(path)
    assert "in: image (1, 3, 224, 224) float; out: logits (1, 1000) float" in str(raised.value)
    for kind, sentence in (
        (YoloSeg, "has not YOLO-seg's layout"),
        (MaskRCNN, "has not Mask R-CNN's layout"),
        (SalientObject, "has the layout of neither U²-Net nor IS-Net"),
    ):
        with pytest.raises(ValueError, match=sentence):
            kind(OnnxNetwork(path))


def test_onnx_runtime_reports_nothing_to_its_makers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[bool] = []
    monkeypatch.setattr("onnxruntime.disable_telemetry_events", lambda: calls.append(True))
    OnnxNetwork(write(tmp_path / "a.onnx", [], [1, 3, 224, 224], {"logits": [1, 1000]}, {"logits_": ONES}))
    assert calls == [True]


def test_yolov5s_layout_is_another(tmp_path: Path) -> None:
    found = np.ones((1, 300, 40), np.float32)
    pool = [("AveragePool", ["image"], "output1", {"kernel_shape": [2, 2], "strides": [2, 2]})]
    five = write(
        tmp_path / "a.onnx", pool, [1, 3, 64, 64], {"output0": list(found.shape), "output1": None}, {"output0_": found}
    )
    with pytest.raises(ValueError, match="has the layout of neither"):
        load_segmenter(five)


@pytest.mark.parametrize(
    ("picture", "sentence"),
    [
        ([1, 1, 64, 64], r"does not take one RGB picture, .* \(in: image \(1, 1, 64, 64\) float; out: logits"),
        ([8, 3, 64, 64], "does not take one RGB picture"),
        ([2, 64, 64, 3], "does not take one RGB picture"),
        ([10], "does not take one RGB picture"),
        ([1, 3, 100_000, 100_000], "takes pictures of more than 4096 pixels a side"),
    ],
)
def test_what_takes_no_picture_is_refused(tmp_path: Path, picture: list[int], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        load_segmenter(write(tmp_path / "a.onnx", [], picture, {"logits": [1, 1000]}, {"logits_": ONES}))


def test_a_file_that_is_missing_damaged_or_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no ONNX file .*none\.onnx"):
        load_segmenter(tmp_path / "none.onnx")
    with pytest.raises(FileNotFoundError, match="there is no ONNX file"):
        load_segmenter(tmp_path)
    whole = yolo(tmp_path / "a.onnx")
    (tmp_path / "half.onnx").write_bytes(whole.read_bytes()[:100])
    (tmp_path / "text.onnx").write_text("hello")
    for name in ("half.onnx", "text.onnx"):
        with pytest.raises(ValueError, match=f"{name} is no ONNX model that ONNX Runtime can read") as raised:
            load_segmenter(tmp_path / name)
        assert "\n" not in str(raised.value)
    monkeypatch.setattr(onnx_network, "LARGEST_FILE", 1000)
    with pytest.raises(ValueError, match="more than an ONNX file can have"):
        load_segmenter(whole)


def test_a_network_that_fails_while_it_runs_says_so_in_one_sentence(tmp_path: Path) -> None:
    # It takes any size and adds something of one size.
    path = write(
        tmp_path / "a.onnx",
        [("Add", ["image", "seven"], "sum", {}), ("ReduceMax", ["sum", "one"], "mask", {"keepdims": 1})],
        [1, 3, "h", "w"],
        {"mask": [1, 1, None, None]},
        {"seven": np.zeros((1, 3, 7, 7), np.float32), "one": np.array([1])},
    )
    with pytest.raises(ValueError, match=r"a\.onnx fails on a picture of 1024 x 1024 pixels") as raised:
        load_segmenter(path)(scene()[0], "mug")
    assert "\n" not in str(raised.value)
