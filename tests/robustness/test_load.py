"""Hundreds of objects through one process leave nothing behind.

KFIT_MANY is their number, 300 by default; what takes long with each of them is done half as often.
"""

from __future__ import annotations

import gc
import io
import multiprocessing
import os
import sys
import tempfile
import threading
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import torch
from blobs import THREADS, Fails, blob, blobs
from PIL import Image
from tiny_model import write_tiny

import kfit
from kfit.callbacks import Pruning, Stopping
from kfit.core import (
    Callback,
    FitResult,
)

MANY = int(os.environ.get("KFIT_MANY", "300"))
MANY_LONG = MANY // 2
# What an object may leave on average; a picture of 64 x 64 that is kept has 49,152 bytes.
LEAST_PICTURE = 4 * 3 * 64 * 64
BYTES = LEAST_PICTURE // 8
# Of the process's memory, which allocators hand out in lumps; over the whole run, as it does not grow object by object.
LUMPS = 48 * 2**20


pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="what is held is read off /proc")


@dataclass(frozen=True)
class Held:
    """What the process holds after garbage was collected."""

    tensors: int
    tensor_bytes: int
    python_bytes: int
    resident: int
    files: int
    threads: int
    processes: int
    temporary: int

    @staticmethod
    def now() -> Held:
        gc.collect()
        # Not isinstance, which asks proxies for what they stand for, nor those that a compiler plans with.
        tensors = [thing for thing in gc.get_objects() if type(thing) in (torch.Tensor, torch.nn.Parameter)]
        storages = {t.untyped_storage().data_ptr(): t.untyped_storage().nbytes() for t in tensors if not t.is_meta}
        return Held(
            len(tensors),
            sum(storages.values()),
            tracemalloc.get_traced_memory()[0],
            int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"),
            len(os.listdir("/proc/self/fd")),
            threading.active_count(),
            len(multiprocessing.active_children()),
            sum(len(folders) + len(files) for _, folders, files in os.walk(tempfile.gettempdir())),
        )


def leaves_nothing(work: Callable[[int], object], count: int, warm: int) -> None:
    """Do work for objects 0 … count − 1, and look at what those after the first few leave behind."""
    tracemalloc.start(1)
    try:
        for number in range(warm):
            work(number)
        before = Held.now()
        for number in range(warm, count):
            work(number)
        after = Held.now()
    finally:
        tracemalloc.stop()
    objects = count - warm
    for name in ("tensors", "files", "threads", "processes", "temporary"):
        # Fewer than one for two objects, as something may be held that the first few did not need.
        assert getattr(after, name) - getattr(before, name) < max(2, objects // 50), (name, before, after)
    for name in ("tensor_bytes", "python_bytes"):
        assert getattr(after, name) - getattr(before, name) < BYTES * objects, (name, before, after)
    if objects * LEAST_PICTURE > LUMPS / 2:
        assert after.resident - before.resident < LUMPS, (before, after)


class Kept(Callback):
    """Keeps a picture an object, as a mistake would."""

    def __init__(self, kind: str) -> None:
        self.kind, self.pictures = kind, []

    def on_end(self, result: FitResult) -> None:
        self.pictures.append(torch.zeros(3, 64, 64) if self.kind == "tensor" else np.zeros((3, 64, 64), np.float32))


class TestNothingIsLeftBehind:
    @pytest.mark.slow
    @pytest.mark.parametrize("kind", ["tensor", "array"])
    def test_one_small_picture_an_object_that_is_kept_is_noticed(self, kind, scratch):
        kept = blobs(Kept(kind), steps=0)
        with pytest.raises(AssertionError, match="tensors" if kind == "tensor" else "python_bytes"):
            leaves_nothing(lambda number: kept(blob(number), seed=number), 30, 10)

    @pytest.mark.parametrize("count", [30, pytest.param(MANY, marks=pytest.mark.slow)])
    def test_by_a_pipeline(self, count, scratch):
        fit = blobs(Pruning({1: 3}), Stopping())
        leaves_nothing(lambda number: fit(blob(number), seed=number), count, min(100, count // 3))

    @pytest.mark.slow
    def test_by_fits_that_break_off(self, scratch):
        fit = blobs(Fails(ZeroDivisionError))

        def broken(number: int) -> None:
            with pytest.raises(ZeroDivisionError):
                fit(blob(number), seed=number)

        leaves_nothing(broken, 24, 8)

    @pytest.mark.slow
    def test_by_poses_of_one_model(self, mug, photos, scratch):
        fit = mug.pipeline(1, 0)

        def pose(number: int) -> None:
            photo = photos[number % THREADS]
            mug.pose(photo.image, mask=photo.mask, seed=number, pipeline=fit)

        leaves_nothing(pose, MANY_LONG, 30)

    @pytest.mark.slow
    def test_by_models_and_pipelines_that_are_made_anew(self, photos, scratch):
        def pose(number: int) -> None:
            model = kfit.load("mug")
            model.pose(photos[0].image, mask=photos[0].mask, pipeline=model.pipeline(1, 0))

        leaves_nothing(pose, 12, 4)

    @pytest.mark.slow
    def test_by_a_video_of_many_frames(self, mug, scratch):
        from kfit.bench.held_out_clip import held_out_clip
        from kfit.tracking import Tracker

        clip = held_out_clip(mug, 1, 4)
        masks = [mask > 0.5 for mask in clip.masks]
        tracker = Tracker(mug, mug.pose(clip.frames[0], mask=masks[0], intrinsics=clip.intrinsics))
        leaves_nothing(lambda number: tracker(clip.frames[number % 4], masks[number % 4]), MANY_LONG, 30)

    @pytest.mark.slow
    def test_by_uploads_of_visitors_who_come_and_go(self, photos, scratch, tmp_path):
        from kfit.app.sessions import MOST_SESSIONS, Sessions

        kept = io.BytesIO()
        rgba = np.concatenate([photos[0].image, photos[0].mask[..., None]], 2)
        Image.fromarray((255 * rgba).round().astype(np.uint8)).save(kept, "png")
        (scratch / "visits").mkdir()
        sessions = Sessions(scratch / "visits")

        def upload(number: int) -> None:
            path = tmp_path / "mug.png"
            path.write_bytes(kept.getvalue())
            sessions.of(str(number)).take(path)

        leaves_nothing(upload, MANY_LONG, 30)
        assert len(list((scratch / "visits").iterdir())) == MOST_SESSIONS

    @pytest.mark.slow
    def test_by_reports(self, mug, photos, scratch, tmp_path):
        result = mug.pose(photos[0].image, mask=photos[0].mask, pipeline=mug.pipeline(2, 1))
        leaves_nothing(lambda number: kfit.report(result, tmp_path / "report.html"), 12, 4)
        assert not sys.modules.get("matplotlib.pyplot") or not matplotlib.pyplot.get_fignums()

    @pytest.mark.slow
    def test_by_epochs_and_data_modules(self, scratch, tmp_path):
        from kfit.data.datamodule import ViewsDataModule

        def epoch(number: int) -> None:
            data = ViewsDataModule("mug", 3, 2, 64, 3, str(tmp_path), num_val_objects=1)
            data.prepare_data()
            data.setup()
            assert len([*data.train_dataloader(), *data.val_dataloader()]) == 3

        leaves_nothing(epoch, 100, 30)


@pytest.mark.slow
def test_a_data_set_of_many_objects_leaves_nothing_behind(photos, scratch, tmp_path, monkeypatch):
    from lightning import Trainer

    from kfit.batch import dataset_fit
    from kfit.batch.photo_folder import PhotoFolder

    sizes = {
        "generator": ("VAE3D", {"code_dim": 2, "volume_dims": [4, 4], "projection_dim": 4, "decoder_dims": [4]}),
        "encoder": ("ConvEncoder", {"code_dim": 2, "channels": [4, 4], "hidden_dim": 4, "image_size": 16}),
        "extents": ("ExtentsHead", {"code_dim": 2, "hidden_dim": 4}),
    }
    networks = {
        name: {"class_path": f"kfit.generators.{kind}", "init_args": args} for name, (kind, args) in sizes.items()
    }
    write_tiny(tmp_path / "mug.safetensors", networks=networks)
    monkeypatch.setattr(dataset_fit, "bundled", lambda: [])
    (tmp_path / "photos").mkdir()
    rgba = np.concatenate([photos[0].image, photos[0].mask[..., None]], 2)
    picture = Image.fromarray((255 * rgba).round().astype(np.uint8))
    for number in range(MANY):
        picture.save(tmp_path / "photos" / f"{number:04}.png")
    fitted = dataset_fit.DatasetFit(tmp_path / "out", {"mug": tmp_path / "mug.safetensors"}, 1, 0)
    found: dict[int, Held] = {}
    step = fitted.predict_step

    def watched(batch: Any, batch_idx: int) -> int:
        if batch_idx in (100, MANY - 1):
            found[batch_idx] = Held.now()
        return step(batch, batch_idx)

    monkeypatch.setattr(fitted, "predict_step", watched)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*LeafSpec.*")
        trainer = Trainer(
            accelerator="cpu", devices=1, logger=False, enable_checkpointing=False, enable_model_summary=False,
            enable_progress_bar=False, default_root_dir=tmp_path / "out",
        )  # fmt: skip
        tracemalloc.start(1)
        try:
            trainer.predict(fitted, datamodule=PhotoFolder(tmp_path / "photos", "mug"), return_predictions=False)
        finally:
            tracemalloc.stop()
    assert fitted.counts["objects"] == MANY
    before, after = found[100], found[MANY - 1]
    assert after.tensors - before.tensors < 20
    assert (after.files, after.threads, after.temporary) == (before.files, before.threads, before.temporary)
    for name in ("tensor_bytes", "python_bytes"):
        assert getattr(after, name) - getattr(before, name) < BYTES * (MANY - 101), name
    assert after.resident - before.resident < LUMPS
