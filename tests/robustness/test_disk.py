"""Full disks and folders that cannot be written to: one sentence, old files as they were, and nothing left behind."""

from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from small_disk import Try

from kfit.cli.main import main
from kfit.runtime.atomic_write import PARTIAL, atomic_write

HERE = Path(__file__).parent
FULL, READ_ONLY = "No space left on device: ", "Read-only file system: "


def run(names: Iterable[str], folder: Path) -> dict[str, list[Try]]:
    """What `disk_commands.py` finds of commands."""
    out = folder / "found.pkl"
    where = os.pathsep.join([str(HERE), str(HERE.parent), str(HERE.parents[1])])
    words = [sys.executable, str(HERE / "disk_commands.py"), str(out), *names]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": where}, check=False)
    if "is refused" in done.stderr:
        pytest.skip(f"no disk can be mounted here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, list[Try]] = pickle.loads(out.read_bytes())
    return found


WRITTEN = {
    "pose": {"kfit_out/pose.json", "kfit_out/overlay.png"},
    "page": {"kfit_out/pose.json", "kfit_out/overlay.png", "pages/page.html"},
    "gif": {"kfit_out/pose.json", "kfit_out/overlay.png", "fit.gif"},
    "mp4": {"kfit_out/pose.json", "kfit_out/overlay.png", "fit.mp4"},
    "video": {"kfit_out/poses.json", "kfit_out/overlay.webm"},
    "model": {"models/tiny.safetensors"},
    "calibrate": {"tiny.safetensors"},
    "evaluate": {"scores/scores.md", "scores/scores.csv", "scores/scores.json", "scores/curves.png"},
    "bench": {"page/README.md"},
}
QUICK, WORKS = ("pose", "model", "bench"), ("views", "training", "data set")


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Try]]:
    return run(QUICK, tmp_path_factory.mktemp("quick"))


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Try]]:
    return run(WRITTEN.keys() - {*QUICK}, tmp_path_factory.mktemp("others"))


@pytest.fixture(scope="module")
def works(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Try]]:
    return run(WORKS, tmp_path_factory.mktemp("works"))


def check(name: str, tries: list[Try]) -> None:
    """One sentence where there is no room or no way to write, and the old files as they were."""
    whole, read_only, *full = tries
    assert (whole.end.status, whole.after.keys()) == (0, WRITTEN[name])
    *failed, last = full
    assert failed  # there was a first room that was too small
    for one, message in [(read_only, READ_ONLY), *((one, FULL) for one in failed)]:
        assert one.end.sentence.startswith(message)
        place = one.end.sentence.removeprefix(message).strip("'").rpartition("disk of " + name + "/")[2]
        # Of what cannot be written to at all, the folder is named, before any work.
        assert place in WRITTEN[name] or (
            one is read_only and any(file.startswith(f"{place}/") for file in WRITTEN[name])
        )
        assert one.after == one.before == whole.after  # byte for byte, and nothing beside
    assert (last.end.status, last.after.keys()) == (0, WRITTEN[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_without_room_there_is_a_sentence_and_the_old_files_stay(name: str, quick: dict[str, list[Try]]) -> None:
    check(name, quick[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(WRITTEN.keys() - {*QUICK}))
def test_without_room_nothing_is_half_written(name: str, others: dict[str, list[Try]]) -> None:
    check(name, others[name])


def checked(name: str, works: dict[str, list[Try]], least: int) -> tuple[dict[str, bytes], dict[str, bytes]]:
    """What was made in one go, and through full disks."""
    whole, *full = works[name]
    *failed, last = full
    assert (whole.end.status, last.end.status) == (0, 0), (whole.end, last.end)
    assert len(failed) >= least
    for one in failed:
        assert one.end.sentence.startswith(FULL)
        assert not [path for path in one.after if PARTIAL in path]
    return whole.after, last.after


@pytest.mark.slow
def test_views_are_built_through_full_disks(works: dict[str, list[Try]]) -> None:
    whole, through = checked("views", works, 2)
    for one in works["views"][1:-1]:
        assert one.before.items() <= one.after.items()  # what was drawn stays
    assert through.keys() == whole.keys() == {"views.h5"}
    with h5py.File(io.BytesIO(whole["views.h5"])) as a, h5py.File(io.BytesIO(through["views.h5"])) as b:
        for field in ("images", "poses", "depth", "extents"):
            np.testing.assert_array_equal(a[field][()], b[field][()])


@pytest.mark.slow
def test_a_data_set_is_fitted_through_full_disks(works: dict[str, list[Try]]) -> None:
    whole, through = checked("data set", works, 1)
    assert len(whole) == 7
    assert through == whole
    for one in works["data set"][1:]:
        assert one.before.items() <= one.after.items() <= whole.items()


@pytest.mark.slow
def test_a_training_goes_on_through_full_disks(works: dict[str, list[Try]]) -> None:
    def last(files: dict[str, bytes]) -> dict[str, torch.Tensor]:
        found = [torch.load(io.BytesIO(files[path]), weights_only=True) for path in files if path.endswith("last.ckpt")]
        newest = max(found, key=lambda one: int(one["epoch"]))
        assert newest["epoch"] == 3
        state: dict[str, torch.Tensor] = newest["state_dict"]
        return state

    whole, through = map(last, checked("training", works, 1))
    for name, tensor in whole.items():
        assert torch.equal(tensor, through[name]), name
    for one in works["training"][1:-1]:
        made = {path: held for path, held in one.before.items() if path.endswith(".ckpt")}
        assert made.items() <= one.after.items()
        for path, held in one.after.items():
            if path.endswith(".ckpt"):
                torch.load(io.BytesIO(held), weights_only=True)


def test_a_place_that_cannot_be_is_named_and_nothing_else_is_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder/b").mkdir(parents=True)
    (tmp_path / "folder/a").write_text("old")
    writers = {"a": lambda path: path.write_text("new"), "b": lambda path: path.write_text("new")}
    with pytest.raises(NotADirectoryError, match=r"Not a directory: '.*/file'$"):
        atomic_write(tmp_path / "file", writers)
    with pytest.raises(NotADirectoryError, match=r"Not a directory: '.*/file/.*'$"):
        atomic_write(tmp_path / "file/below", writers)
    with pytest.raises(IsADirectoryError, match=r"Is a directory: '.*/folder/b'$"):
        atomic_write(tmp_path / "folder", writers)
    assert (tmp_path / "folder/a").read_text() == (tmp_path / "file").read_text() == "old"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "b", "file", "folder"]


def test_an_error_of_what_is_read_meanwhile_is_reported_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"'none'$"):
        atomic_write(tmp_path, {"a": lambda path: path.write_text(Path("none").read_text())})


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_an_answer_that_cannot_be_reported_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        with pytest.raises(SystemExit) as end:
            main(["completion", "fish"])
        monkeypatch.undo()
        assert end.value.code == 2
        assert capsys.readouterr().err in {f"kfit: {FULL}'standard output'\n", f"kfit: {FULL.removesuffix(': ')}\n"}


def test_a_mistake_that_cannot_be_reported_ends_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stderr", Full())
    with pytest.raises(SystemExit) as end:
        main(["pose", "none.png"])
    assert end.value.code == 2
