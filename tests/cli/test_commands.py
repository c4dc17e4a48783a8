from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread, imsave

from kfit.cli.main import main
from kfit.data import build, pose_view


@pytest.fixture(scope="module")
def cutout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drawn mug with an alpha channel."""
    mesh, light = build("mug", 7)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    pixels = np.concatenate([view.image, view.mask[..., None]], 2)
    path = tmp_path_factory.mktemp("photos") / "mug.png"
    imsave(path, (255 * pixels).round().astype(np.uint8), check_contrast=False)
    return path


def test_pose_writes_json_and_overlay_and_prints_one_line(
    cutout: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["pose", str(cutout), "--category", "mug", "--out", str(tmp_path / "out")])
    printed = capsys.readouterr()
    assert len(printed.out.splitlines()) == 1
    assert printed.out.startswith("mug ")
    assert "estimated" in printed.err
    assert json.loads((tmp_path / "out/pose.json").read_text())["category"] == "mug"
    assert imread(tmp_path / "out/overlay.png").shape[2] == 3
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["overlay.png", "pose.json"]


def test_a_recipe_may_name_parts_in_the_working_folder(
    cutout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place not in ("", str(tmp_path))])
    Path("own_energy_of_this_test.py").write_text("from kfit.energies import L2\n\nclass Own(L2):\n    pass\n")
    Path("fit.yaml").write_text(
        "energies: {own: own_energy_of_this_test.Own}\n"
        "initializers:\n"
        "  - {class_path: kfit.initializers.SphereGrid}\n"
        "  - {class_path: kfit.initializers.Constant, init_args: {values: {roll: 0.0, shift: 0.0, scale: 1.0}}}\n"
        "optimizer: kfit.optimizers.Adam\nnum_starts: 1\nnum_steps: 0\n"
    )
    main(["pose", str(cutout), "--category", "mug", "--fit", "fit.yaml", "--out", "out"])
    assert "mug" in capsys.readouterr().out
    assert sys.path[-1] == str(tmp_path)


@pytest.mark.slow
def test_pose_prints_the_json_on_request(cutout: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    camera = ["--intrinsics", "300", "300", "63.5", "63.5"]
    main(["pose", str(cutout), "--category", "mug", "--out", str(tmp_path), "--json", *camera])
    printed = json.loads(capsys.readouterr().out)
    assert printed["intrinsics_assumed"] is False
    assert printed == json.loads((tmp_path / "pose.json").read_text())


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stopped:
        main(words)
    printed = capsys.readouterr()
    assert stopped.value.code == 2
    assert printed.out == ""
    assert "Traceback" not in printed.err
    return printed.err


def test_a_users_mistake_gets_one_sentence_and_writes_nothing(
    cutout: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, empty, damaged = tmp_path / "a.txt", tmp_path / "empty.png", tmp_path / "bad.safetensors"
    text.write_text("no picture")
    imsave(empty, np.zeros((128, 128), np.uint8), check_contrast=False)
    damaged.write_bytes(b"1234")
    mug = ["--category", "mug", "--out", str(tmp_path / "out")]
    for words, sentence in [
        (["nothing.jpg", *mug], "nothing.jpg"),
        ([str(text), *mug], "a.txt"),
        ([str(cutout), *mug, "--mask", str(empty)], "is empty"),
        ([str(cutout), *mug, "--box", "500", "0", "20", "20"], "outside the picture of 128 x 128"),
        ([str(cutout), *mug, "--box", "5", "5", "0", "20"], "has no area"),
        ([str(cutout), *mug, "--box", "5", "5", "20", "20", "--mask", str(empty)], "both given"),
        ([str(cutout), "--category", "teapot"], "those known are"),
        ([str(cutout), "--model", str(damaged)], "damaged"),
        ([str(cutout), "--category", "mug", "--model", "a.safetensors"], "both given"),
        (["https://example.org/photo.jpg", *mug], "is an address"),
        (["clip.mp4", *mug], "clip.mp4"),
        ([str(cutout), *mug, "--depth", "d.png"], "no file d.png"),
        ([str(cutout), *mug, "--depth", str(empty)], "16-bit picture of millimetres"),
    ]:
        err = refused(["pose", *words], capsys)
        assert sentence in err
        assert len(err.splitlines()) == 1, err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_bench_accuracy_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    main(["bench", "accuracy", "--categories", "[mug]", "--views", "2", "--starts", "2", "--steps", "1"])
    printed = capsys.readouterr().out
    assert "median" in printed
    assert "pictures drawn" in printed


def test_python_dash_m_kfit_is_the_console_script() -> None:
    done = subprocess.run([sys.executable, "-m", "kfit", "--help"], capture_output=True, text=True, check=True)
    assert "pose" in done.stdout
    assert "predict" in done.stdout


def test_importing_the_commands_loads_no_torch() -> None:
    code = "import sys, kfit.cli.main; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_an_answer_imports_nothing_that_it_does_not_need(cutout: Path, tmp_path: Path) -> None:
    # Each costs a tenth to half a second of the answer to a photo.
    heavy = {"sympy", "matplotlib", "lightning", "h5py", "scipy", "skimage", "trimesh", "pandas", "torch._dynamo"}
    # torch 2.6 loads sympy for its checkpoints, which Kornia imports.
    code = "import sys, kornia, onnxruntime, torch.utils.checkpoint; theirs = set(sys.modules); "
    code += "from kfit.cli.main import main; main(sys.argv[1:]); print(*set(sys.modules) - theirs)"
    words = ["pose", str(cutout), "--category", "mug", "--out", str(tmp_path)]
    found = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    modules = set(found.stdout.splitlines()[-1].split())
    assert heavy & modules == set()
    assert 100 < len(modules) < 600
