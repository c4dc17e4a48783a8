"""`kfit pose --segmenter`, on a drawn mug before a ground of another colour."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from skimage.io import imsave

from kfit.cli.main import main
from kfit.data import build, pose_view

BOX = (20, 20, 108, 108)


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh, light = build("mug", 7)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    path = tmp_path_factory.mktemp("photos") / "mug.png"
    imsave(path, (255 * view.image).round().astype(np.uint8), check_contrast=False)
    return path


def detector(path: Path, name: str) -> Path:
    """YOLO-seg of 128 x 128 pixels that sees a disc in the middle of whatever it is shown."""
    away = np.arange(32) - 15.5
    prototype = np.where(away[:, None] ** 2 + away**2 < 10**2, 9, -9).astype(np.float32)
    found = np.zeros((1, 2, 7), np.float32)
    found[0, 0] = [*BOX, 0.9, 0, 1]
    constants = {"found": found, "prototypes": prototype[None, None]}
    graph = helper.make_graph(
        [
            helper.make_node("Identity", [kind], [out])
            for kind, out in zip(constants, ("output0", "output1"), strict=True)
        ],
        "detector",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 128, 128])],
        [helper.make_tensor_value_info(f"output{i}", TensorProto.FLOAT, None) for i in range(2)],
        [numpy_helper.from_array(array, kind) for kind, array in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    helper.set_model_props(model, {"names": str({0: name})})
    onnx.save(model, path)
    return path


@pytest.mark.slow
def test_pose_takes_the_detection_of_its_category(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segmenter = str(detector(tmp_path / "a.onnx", "cup"))
    main(["pose", str(photo), "--category", "mug", "--segmenter", segmenter, "--out", str(tmp_path), "--json"])
    printed = json.loads(capsys.readouterr().out)
    assert np.abs(np.array(printed["bbox_xywh"]) - (24, 24, 80, 80)).max() <= 2
    assert not any("whole picture" in note for note in printed["notes"])


def test_pose_says_in_a_sentence_why_a_segmenter_does_not_serve(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bowls = str(detector(tmp_path / "a.onnx", "bowl"))
    mug = ["pose", str(photo), "--category", "mug", "--out", str(tmp_path / "out")]
    for words, sentence in [
        (["--segmenter", str(tmp_path / "none.onnx")], "there is no ONNX file"),
        (["--segmenter", str(photo)], "is no ONNX model that ONNX Runtime can read"),
        (["--segmenter", bowls], "none of the segmenter's 1 classes (bowl) is a mug"),
        (["--segmenter", bowls, "--box", "1", "1", "20", "20"], "no detection fills box (1, 1, 20, 20)"),
        (["--segmenter", bowls, "--mask", "m.png"], "--mask and --segmenter were both given"),
    ]:
        with pytest.raises(SystemExit) as stopped:
            main([*mug, *words])
        err = capsys.readouterr().err
        assert stopped.value.code == 2
        assert sentence in err
        assert len(err.splitlines()) == 1, err
    assert not (tmp_path / "out").exists()
