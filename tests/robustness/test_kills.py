"""kill -9 at random moments: nothing is lost but what was in flight, no file is half there, results stay the same.

Processes are forked from this one, which has imported everything, so that a kill hits the work. Each is repeated
KFIT_KILLS times, three unless said otherwise.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from kfit.data.rendered_views import build_views
from kfit.runtime.atomic_write import PARTIAL

KILLS = int(os.environ.get("KFIT_KILLS", "3"))
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")]


def start(work: Callable[[], object]) -> int:
    """A process that does the work and ends."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads are not forked along
        process = os.fork()
    if process == 0:
        status = 1
        try:
            os.setsid()
            torch.set_num_threads(1)
            work()
            status = 0
        finally:
            os._exit(status)
    return process


def kill_and_go_on(work: Callable[[], object], seconds: float, rng: random.Random, check: Callable[[], object]) -> int:
    """Start the work, kill it, look at what is there; again until it ends by itself. How often it was killed."""
    for killed in range(100):
        process = start(work)
        # The later tries are given more time, so that they end.
        timer = threading.Timer(
            rng.uniform(0.02, seconds * (0.5 + 0.25 * killed)), os.killpg, (process, signal.SIGKILL)
        )
        timer.start()
        _, status = os.waitpid(process, 0)
        timer.cancel()
        check()
        if not os.WIFSIGNALED(status):
            assert os.WEXITSTATUS(status) == 0
            return killed
    raise AssertionError("the work never ended")


def arrays(path: Path) -> dict[str, np.ndarray]:
    with h5py.File(path) as file:
        return {name: file[name][()] for name in ("images", "poses", "depth", "extents")}


def test_views_are_built_through_kills(tmp_path: Path) -> None:
    def build(path: Path) -> Path:
        return build_views(path, "mug", 16, 2, image_size=24)

    begun = time.perf_counter()
    whole = arrays(build(tmp_path / "whole.h5"))
    seconds, rng, killed = time.perf_counter() - begun, random.Random(0), 0
    for number in range(KILLS):
        path = tmp_path / f"{number}.h5"
        parts = path.with_name(path.name + ".partial")
        there: set[str] = set()

        def check(path: Path = path, parts: Path = parts, there: set[str] = there) -> None:
            now = {part.name for part in parts.glob("*.npz")}
            assert there <= now or path.exists()  # what was drawn stays
            there.update(now)
            if path.exists():
                arrays(path)

        killed += kill_and_go_on(lambda path=path: build(path), seconds, rng, check)
        for name, array in whole.items():
            np.testing.assert_array_equal(array, arrays(path)[name])
        assert not parts.exists()
    assert killed >= KILLS / 2


def test_two_processes_that_build_the_same_views_end_with_one_file(tmp_path: Path) -> None:
    path = tmp_path / "views.h5"
    processes = [start(lambda: build_views(path, "mug", 16, 2, image_size=24)) for _ in range(2)]
    assert [os.waitpid(process, 0)[1] for process in processes] == [0, 0]
    whole = arrays(build_views(tmp_path / "whole.h5", "mug", 16, 2, image_size=24))
    for name, array in arrays(path).items():
        np.testing.assert_array_equal(array, whole[name])
    assert [entry.name for entry in sorted(tmp_path.iterdir()) if not entry.name.startswith(PARTIAL)] == [
        "views.h5",
        "whole.h5",
    ]


TRAINING = [
    "fit", "--seed_everything", "0", "--trainer.accelerator", "cpu", "--trainer.enable_progress_bar", "false",
    "--trainer.enable_model_summary", "false", "--trainer.num_sanity_val_steps", "0", "--trainer.logger", "false",
    "--trainer.callbacks", "ModelCheckpoint", "--trainer.callbacks.filename", "last",
    "--trainer.callbacks.enable_version_counter", "false", "--trainer.max_epochs", "4",
    "--model", "kfit.training.PoseTraining", "--model.pose_head", "kfit.generators.RotationHead",
    "--model.pose_head.init_args.channels", "[4, 4, 4, 4]", "--model.pose_head.init_args.hidden_dim", "8",
    "--model.recoloring", "kfit.training.RandomRecolor",
    "--data", "kfit.data.ViewsDataModule", "--data.num_objects", "8", "--data.num_views", "4",
    "--data.num_val_objects", "1", "--data.batch_size", "4",
]  # fmt: skip


def test_a_training_goes_on_through_kills_as_if_nothing_had_been(tmp_path: Path) -> None:
    from kfit.training import lightning_cli as lightning

    def train(folder: Path) -> None:
        warnings.simplefilter("ignore")
        checkpoints = sorted(folder.rglob("last.ckpt"), key=lambda path: path.stat().st_mtime)
        goes_on = ["--ckpt_path", str(checkpoints[-1])] if checkpoints else []
        where = ["--data.cache_dir", str(tmp_path / "cache"), "--trainer.default_root_dir", str(folder)]
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
            lightning.run([*TRAINING, *where, *goes_on])

    def weights(folder: Path) -> dict[str, torch.Tensor]:
        newest = max(folder.rglob("last.ckpt"), key=lambda path: path.stat().st_mtime)
        saved = torch.load(newest, weights_only=True)
        assert saved["epoch"] == 3
        found: dict[str, torch.Tensor] = saved["state_dict"]
        return found

    def check_checkpoints(folder: Path) -> None:
        for path in folder.rglob("*.ckpt"):
            torch.load(path, weights_only=True)

    assert os.waitpid(start(lambda: train(tmp_path / "first")), 0)[1] == 0  # renders the views
    begun = time.perf_counter()
    assert os.waitpid(start(lambda: train(tmp_path / "whole")), 0)[1] == 0
    seconds, rng, killed = time.perf_counter() - begun, random.Random(0), 0
    whole = weights(tmp_path / "whole")
    for number in range(KILLS):
        folder = tmp_path / f"{number}"
        killed += kill_and_go_on(
            lambda folder=folder: train(folder), seconds, rng, lambda folder=folder: check_checkpoints(folder)
        )
        for name, tensor in weights(folder).items():
            assert torch.equal(tensor, whole[name]), name
    assert killed >= KILLS / 2


def test_a_data_set_is_fitted_through_kills(tmp_path: Path) -> None:
    from lightning import Trainer
    from nocs_lookalike import write_frames
    from tiny_model import write_tiny

    from kfit.batch.dataset_fit import DatasetFit
    from kfit.batch.nocs_fit import NOCSFit

    write_tiny(tmp_path / "mug.safetensors")
    write_frames(tmp_path / "nocs", [("mug", "mug"), ("mug",), ("mug", "mug", "mug"), (), ("mug",), ("mug", "mug")])

    def fit(out: Path) -> None:
        warnings.simplefilter("ignore")
        module = DatasetFit(out, {"mug": tmp_path / "mug.safetensors"}, num_starts=2, num_steps=2)
        trainer = Trainer(
            accelerator="cpu", devices=1, logger=False, enable_checkpointing=False, enable_model_summary=False,
            enable_progress_bar=False, default_root_dir=tmp_path,
        )  # fmt: skip
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
            trainer.predict(module, datamodule=NOCSFit(tmp_path / "nocs", "real_test"), return_predictions=False)

    def contents(out: Path) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in sorted(out.iterdir()) if path.is_file()}

    begun = time.perf_counter()
    assert os.waitpid(start(lambda: fit(tmp_path / "whole")), 0)[1] == 0
    seconds, rng, killed = time.perf_counter() - begun, random.Random(0), 0
    whole = contents(tmp_path / "whole")
    assert len(whole) == 7
    for number in range(KILLS):
        out = tmp_path / f"{number}"

        def check(out: Path = out) -> None:
            if out.is_dir():
                assert contents(out).items() <= whole.items()  # whole files, and the right ones

        killed += kill_and_go_on(lambda out=out: fit(out), seconds, rng, check)
        assert contents(out) == whole
        assert not list(out.glob(f"{PARTIAL}*"))
    assert killed >= KILLS / 2
