"""`kfit video`, on a drawn laptop before a photo."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from skimage.io import imsave
from tiny_model import TINY, write_tiny

from kfit.bench.held_out_clip import Clip, held_out_clip
from kfit.cli.main import main
from kfit.geometry import rotation_error
from kfit.models import load
from kfit.pose import CategoryModel

FRAMES = 4
CAMERA = ["--intrinsics", "384", "384", "159.5", "119.5"]


@pytest.fixture(scope="module")
def truth() -> Clip:
    return held_out_clip(load("laptop"), 0, FRAMES)


@pytest.fixture(scope="module")
def videos(truth: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip, its frames in a folder, and its masks in another; the third frame's is empty."""
    folder = tmp_path_factory.mktemp("videos")
    video = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 20, (320, 240))
    for number, (frame, mask) in enumerate(zip(truth.frames, truth.masks, strict=True)):
        pixels = (255 * frame).round().astype(np.uint8)
        video.write(pixels[..., ::-1])
        for place, picture in {"frames": pixels, "masks": np.uint8(255) * (mask > 0.5) * (number != 2)}.items():
            (folder / place).mkdir(exist_ok=True)
            imsave(folder / place / f"{number + 8}.png", picture, check_contrast=False)  # 8, 9, 10, 11
    video.release()
    return folder


def answers(folder: Path) -> tuple[dict, list[dict]]:
    assert sorted(path.name for path in folder.iterdir()) == ["overlay.webm", "poses.json"]
    saved = json.loads((folder / "poses.json").read_text())
    return saved, saved["frames"]


def num_pictures(path: Path) -> int:
    video, number = cv2.VideoCapture(str(path)), 0
    while video.read()[0]:
        number += 1
    return number


@pytest.fixture
def short_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small untrained model with a pose head, whose own fit is short."""
    sizes = {"channels": [8, 8, 8, 8], "hidden_dim": 8}
    head = {"class_path": "kfit.generators.PoseHead", "init_args": sizes}
    pipeline = CategoryModel.pipeline
    monkeypatch.setattr(CategoryModel, "pipeline", lambda self, **settings: pipeline(self, 2, 1, **settings))
    return write_tiny(tmp_path / "tiny.safetensors", networks={**TINY, "pose_head": head})


def test_each_frame_of_a_folder_gets_an_entry(
    short_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        picture = np.full((48, 64, 3), 255, np.uint8)
        picture[10:40, 15 + number : 45 + number] = (200, 60, 40)
        for folder, pixels in {"frames": picture, "masks": np.uint8(255) * (picture[..., 1] < 255)}.items():
            (tmp_path / folder).mkdir(exist_ok=True)
            imsave(tmp_path / folder / f"{number}.png", pixels, check_contrast=False)
    selection = ["--model", str(short_model), "--masks", str(tmp_path / "masks")]
    main(["video", str(tmp_path / "frames"), *selection, "--out", str(tmp_path / "out")])
    assert len(capsys.readouterr().out.splitlines()) == 1
    saved, frames = answers(tmp_path / "out")
    assert [frame["frame"] for frame in frames] == [0, 1, 2]
    assert frames[0]["anew"]
    assert all(len(frame["rotation"]) == len(frame["size"]) == 3 for frame in frames if frame["found"])
    assert saved["summary"]["frames"] == num_pictures(tmp_path / "out/overlay.webm") == 3


@pytest.mark.slow
def test_a_clip_is_followed(videos: Path, truth: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mask = str(videos / "masks/8.png")
    main(["video", str(videos / "clip.mp4"), "--category", "laptop", "--mask", mask, "--out", str(tmp_path), *CAMERA])
    printed = capsys.readouterr()
    assert printed.out.startswith("laptop found in 4 of 4 frames; confidence ")
    assert len(printed.out.splitlines()) == 1
    assert all(line.startswith("kfit: ambiguous: ") for line in printed.err.splitlines())
    saved, frames = answers(tmp_path)
    confidences = [frame["confidence"] for frame in frames]
    assert saved["summary"]["frames"] == saved["summary"]["found"] == 4
    assert saved["summary"]["high_confidence"] == sum(confidence >= 0.8 for confidence in confidences)
    assert saved["summary"]["median_confidence"] == sorted(confidences)[2]
    assert (saved["category"], saved["intrinsics_from"], saved["intrinsics"][0][0]) == ("laptop", "given", 384)
    assert [frame["frame"] for frame in frames] == [0, 1, 2, 3]
    assert [frame["time"] for frame in frames] == pytest.approx([0, 0.05, 0.1, 0.15])
    assert [frame["anew"] for frame in frames] == [True, False, False, False]
    found = torch.tensor([frame["rotation"] for frame in frames], dtype=torch.float64)
    assert float(rotation_error(found, truth.rotation).rad2deg().max()) < 10
    assert all(len(frame["translation"]) == len(frame["size"]) == 3 and frame["overlap"] > 0.8 for frame in frames)
    assert num_pictures(tmp_path / "overlay.webm") == 4


@pytest.mark.slow
def test_a_folder_is_tracked_by_its_masks_and_an_empty_frame_has_no_pose(
    videos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = ["--masks", str(videos / "masks"), "--out", str(tmp_path)]
    main(["video", str(videos / "frames"), "--category", "laptop", *inputs])
    printed = capsys.readouterr()
    assert printed.out.startswith("laptop found in 3 of 4 frames; confidence ")
    assert "estimated" in printed.err
    saved, frames = answers(tmp_path)
    assert "estimated" in " ".join(saved["notes"])
    assert [frame["time"] for frame in frames] == [None] * 4
    assert [frame["found"] for frame in frames] == [True, True, False, True]
    lost = {"found": False, "anew": False, "rotation": None, "translation": None, "size": None, "energy": None}
    assert frames[2] == {"frame": 2, "time": None, **lost, "confidence": 0, "overlap": 0}
    assert num_pictures(tmp_path / "overlay.webm") == 4


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stopped:
        main(["video", *words])
    printed = capsys.readouterr()
    assert (stopped.value.code, printed.out, printed.err.count("\n")) == (2, "", 1)
    return printed.err


def test_a_users_mistake_gets_one_sentence_and_writes_nothing(
    videos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip, masks = str(videos / "clip.mp4"), str(videos / "masks")
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks/1.png").write_bytes((videos / "masks/8.png").read_bytes())
    few, out = str(tmp_path / "masks"), ["--out", str(tmp_path / "out")]
    laptop = ["--category", "laptop", *out]
    assert "name the object by either" in refused([clip, *out], capsys)
    assert "--mask and --masks were both given" in refused([clip, "--mask", "m", "--masks", masks, *laptop], capsys)
    assert "there is no clip or folder none.mp4" in refused(["none.mp4", *laptop], capsys)
    assert "holds 1 masks for 4 frames" in refused([str(videos / "frames"), "--masks", few, *laptop], capsys)
    assert "--model must name a .safetensors file" in refused([clip, "--model", "model.pt", *out], capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_clip_of_more_frames_than_masks_is_refused_and_writes_nothing(
    videos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks/1.png").write_bytes((videos / "masks/8.png").read_bytes())
    words = [str(videos / "clip.mp4"), "--masks", str(tmp_path / "masks"), "--category", "laptop", *CAMERA]
    assert "has more frames" in refused([*words, "-q", "--out", str(tmp_path / "out")], capsys)  # notes of a first fit
    assert not (tmp_path / "out").exists()


def test_a_model_without_a_pose_head_is_refused_before_a_fit(
    tiny_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CategoryModel, "pose", lambda *args, **named: pytest.fail("fitted in vain"))
    imsave(tmp_path / "0.png", np.full((48, 64, 3), 200, np.uint8), check_contrast=False)
    words = [str(tmp_path), "--model", str(tiny_file), "--out", str(tmp_path / "out")]
    assert "has no pose head, which tracking needs" in refused(words, capsys)


@pytest.mark.slow
def test_a_broken_clip_is_reported_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "no.mp4").write_text("no clip")
    words = [sys.executable, "-m", "kfit", "video", str(tmp_path / "no.mp4"), "--category", "mug"]
    ran = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert ran.returncode == 2
    assert ran.stderr == f"kfit: {tmp_path}/no.mp4 is not a clip that can be read, is damaged, or holds no frame\n"
    assert not (tmp_path / "kfit_out").exists()
