"""A thousand objects through one process leave nothing behind; threads get the answers that they get alone."""

from __future__ import annotations

import gc
import io
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import tracemalloc
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import torch
from PIL import Image

import kfit
from kfit.callbacks import Progress, Pruning, Stopping
from kfit.core import (
    Angle,
    Callback,
    FitResult,
    FitState,
    Generator,
    Observation,
    Rendering,
    Variable,
)
from kfit.data import build, pose_view
from kfit.energies import L2, SSIM, Perceptual
from kfit.features import EfficientNetLite0
from kfit.generators import VAE3D, ConvEncoder, ExtentsHead
from kfit.initializers import Uniform
from kfit.models import Card, CategoryModel, PoseResult, write_model
from kfit.optimizers import Adam
from kfit.pipeline import FitPipeline
from kfit.segmentation import mask_from_box, read_photo

MANY, THREADS = 1000, 8
# What an object may leave on average; a picture of 64 x 64 that is kept has 49,152 bytes.
LEAST_PICTURE = 4 * 3 * 64 * 64
BYTES = LEAST_PICTURE // 8
# Of the process's memory, which allocators hand out in lumps; over the whole run, as it does not grow object by object.
LUMPS = 48 * 2**20


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
        # Not isinstance, which asks proxies for what they stand for.
        tensors = [thing for thing in gc.get_objects() if issubclass(type(thing), torch.Tensor)]
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


pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="what is held is read off /proc")


class Blob(Generator):
    """A disc of light about a place, 64 pixels wide."""

    def __init__(self) -> None:
        super().__init__()
        self.variables = {"place": Variable((2,)), "hue": Variable((), Angle())}

    def forward(self, **values: torch.Tensor) -> Rendering:
        y, x = torch.meshgrid(*[torch.linspace(-1, 1, 64)] * 2, indexing="ij")
        away = (x - values["place"][:, :1, None]).square() + (y - values["place"][:, 1:, None]).square()
        mask = torch.exp(-4 * away)[:, None]
        tint = torch.stack([values["hue"].cos(), values["hue"].sin(), torch.ones_like(values["hue"])], 1)
        return Rendering(1 - mask * (0.5 + 0.4 * tint[:, :, None, None]), mask)


class Kept(Callback):
    """Keeps a picture an object, as a mistake would."""

    def __init__(self, kind: str) -> None:
        self.kind, self.pictures = kind, []

    def on_end(self, result: FitResult) -> None:
        self.pictures.append(torch.zeros(3, 64, 64) if self.kind == "tensor" else np.zeros((3, 64, 64), np.float32))


class Fails(Callback):
    """Breaks off at the second step what has one start alone, or all."""

    def __init__(self, error: type[BaseException], only: str = "") -> None:
        self.error, self.only = error, only

    def on_step(self, state: FitState) -> FitState:
        if state.step == 1 and self.only in threading.current_thread().name:
            raise self.error("as was asked for")
        return state


def blobs(*callbacks: Callback, steps: int = 3, energies: dict[str, Any] | None = None) -> FitPipeline:
    starts = [Uniform("place", -0.5, 0.5), Uniform("hue", -1.0, 1.0)]
    kept = {"callbacks": callbacks, "num_starts": 4, "num_steps": steps}
    return FitPipeline(Blob(), energies or {"image": L2()}, starts, Adam(0.05), **kept)


def blob(number: int) -> Observation:
    values = torch.tensor([[0.05 * (number % 8), -0.2]]), torch.tensor([0.1 * (number % 8)])
    drawn = Blob()(place=values[0], hue=values[1])
    return Observation(drawn.image, drawn.mask, keys=(number,))


def same_history(one: FitResult, other: FitResult) -> None:
    torch.testing.assert_close(one.history.energy, other.history.energy, rtol=0, atol=0, equal_nan=True)
    for name, value in other.history.values.items():
        torch.testing.assert_close(one.history.values[name], value, rtol=0, atol=0, equal_nan=True)
    assert one.start.tolist() == other.start.tolist()
    assert one.num_evaluations == other.num_evaluations


def same_answer(one: PoseResult, other: PoseResult) -> None:
    same_history(one.fit, other.fit)
    assert one.to_dict() == other.to_dict()
    np.testing.assert_array_equal(one.drawing, other.drawing)
    np.testing.assert_array_equal(one.mask, other.mask)


def at_once(work: Callable[[int], Any], count: int = THREADS) -> list[Any]:
    """What threads find that begin together; tasks have threads of their own."""
    begin = threading.Barrier(count)

    def one(number: int) -> Any:
        begin.wait()
        return work(number)

    with ThreadPoolExecutor(count, "load") as pool:
        return list(pool.map(one, range(count)))


@pytest.fixture(scope="module")
def mug() -> CategoryModel:
    return kfit.load("mug")


@pytest.fixture(scope="module")
def photos() -> list[Any]:
    return [seen("mug", number) for number in range(THREADS)]


def seen(category: str, number: int) -> Any:
    mesh, light = build(category, number)
    return pose_view(mesh, 0.5, 0.3 * number, light, 96)


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of temporary files that nobody else writes to."""
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    return tmp_path / "scratch"


class TestNothingIsLeftBehind:
    @pytest.mark.parametrize("kind", ["tensor", "array"])
    def test_one_small_picture_an_object_that_is_kept_is_noticed(self, kind, scratch):
        kept = blobs(Kept(kind), steps=0)
        with pytest.raises(AssertionError, match="tensors" if kind == "tensor" else "python_bytes"):
            leaves_nothing(lambda number: kept(blob(number), seed=number), 30, 10)

    @pytest.mark.parametrize("count", [30, pytest.param(MANY, marks=pytest.mark.slow)])
    def test_by_a_pipeline(self, count, scratch):
        fit = blobs(Pruning({1: 3}), Stopping())
        leaves_nothing(lambda number: fit(blob(number), seed=number), count, min(100, count // 3))

    def test_by_fits_that_break_off(self, scratch):
        fit = blobs(Fails(ZeroDivisionError))

        def broken(number: int) -> None:
            with pytest.raises(ZeroDivisionError):
                fit(blob(number), seed=number)

        leaves_nothing(broken, 24, 8)

    @pytest.mark.parametrize("count", [10, pytest.param(MANY, marks=pytest.mark.slow)])
    def test_by_poses_of_one_model(self, mug, photos, count, scratch):
        fit = mug.pipeline(1, 0)

        def pose(number: int) -> None:
            photo = photos[number % THREADS]
            mug.pose(photo.image, mask=photo.mask, seed=number, pipeline=fit)

        leaves_nothing(pose, count, min(100, count // 2))

    @pytest.mark.slow
    def test_by_models_and_pipelines_that_are_made_anew(self, photos, scratch):
        def pose(number: int) -> None:
            model = kfit.load("mug")
            model.pose(photos[0].image, mask=photos[0].mask, pipeline=model.pipeline(1, 0))

        leaves_nothing(pose, 30, 10)

    @pytest.mark.slow
    def test_by_a_video_of_a_thousand_frames(self, mug, scratch):
        from kfit.models import Follower
        from kfit.models.clips import unseen_clip

        clip = unseen_clip(mug, 1, 4)
        masks = [mask > 0.5 for mask in clip.masks]
        follower = Follower(mug, mug.pose(clip.frames[0], mask=masks[0], intrinsics=clip.intrinsics))
        leaves_nothing(lambda number: follower(clip.frames[number % 4], masks[number % 4]), MANY, 100)

    @pytest.mark.parametrize("count", [40, pytest.param(MANY, marks=pytest.mark.slow)])
    def test_by_uploads_of_visitors_who_come_and_go(self, photos, count, scratch, tmp_path):
        from kfit.app.session import MOST_SESSIONS, Sessions

        kept = io.BytesIO()
        rgba = np.concatenate([photos[0].image, photos[0].mask[..., None]], 2)
        Image.fromarray((255 * rgba).round().astype(np.uint8)).save(kept, "png")
        (scratch / "visits").mkdir()
        sessions = Sessions(scratch / "visits")

        def upload(number: int) -> None:
            path = tmp_path / "mug.png"
            path.write_bytes(kept.getvalue())
            sessions.of(str(number)).take(path)

        leaves_nothing(upload, count, min(100, count // 2))
        assert len(list((scratch / "visits").iterdir())) == MOST_SESSIONS

    @pytest.mark.slow
    def test_by_reports(self, mug, photos, scratch, tmp_path):
        result = mug.pose(photos[0].image, mask=photos[0].mask, pipeline=mug.pipeline(2, 1))
        leaves_nothing(lambda number: kfit.report(result, tmp_path / "report.html"), 30, 10)
        assert not sys.modules.get("matplotlib.pyplot") or not matplotlib.pyplot.get_fignums()

    @pytest.mark.slow
    def test_by_epochs_and_data_modules(self, scratch, tmp_path):
        from kfit.data.datamodule import ViewsDataModule

        def epoch(number: int) -> None:
            data = ViewsDataModule("mug", 3, 2, 64, 3, str(tmp_path), num_val_objects=1)
            data.prepare_data()
            data.setup()
            assert len([*data.train_dataloader(), *data.val_dataloader()]) == 3

        leaves_nothing(epoch, 200, 50)


@pytest.mark.slow
def test_a_data_set_of_a_thousand_objects_leaves_nothing_behind(photos, scratch, tmp_path, monkeypatch):
    from lightning import Trainer

    from kfit.models import dataset_fit
    from kfit.models.photo_folder import PhotoFolder

    said = {
        "generator": (VAE3D, {"code_dim": 2, "volume_dims": [4, 4], "projection_dim": 4, "decoder_dims": [4]}),
        "encoder": (ConvEncoder, {"code_dim": 2, "channels": [4, 4], "hidden_dim": 4, "image_size": 8}),
        "extents": (ExtentsHead, {"code_dim": 2, "hidden_dim": 4}),
    }
    named = {
        name: {"class_path": f"kfit.generators.{kind.__name__}", "init_args": args}
        for name, (kind, args) in said.items()
    }
    said["encoder"][1]["image_size"] = getattr(VAE3D(**said["generator"][1]), "image_size", 64)
    card = Card("mug", named, 4.0, 1.0, (-15.0, 75.0), "y up", "none", 0.17)
    write_model(tmp_path / "mug.safetensors", {name: kind(**args) for name, (kind, args) in said.items()}, card)
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


class TestThreads:
    def test_that_share_a_pipeline_get_the_answers_that_they_get_alone(self):
        energies = {"image": SSIM(), "features": Perceptual(EfficientNetLite0((0,)))}
        fit = blobs(Pruning({1: 3}), Stopping(0.2, 1), energies=energies)
        alone = [fit(blob(number), seed=number) for number in range(THREADS)]
        assert len({result.num_evaluations for result in alone}) > 1  # some stop earlier
        for one, other in zip(at_once(lambda number: fit(blob(number), seed=number)), alone, strict=True):
            same_history(one, other)

    def test_that_share_a_model_get_the_answers_that_they_get_alone(self, mug, photos):
        fit = mug.pipeline(2, 1, [Pruning({0: 1})])

        def pose(number: int) -> PoseResult:
            told = {"mask": photos[number].mask} if number > 1 else {"box": (4.0, 4.0, 88.0, 88.0)}
            return mug.pose(photos[number].image, **told, seed=number, pipeline=fit)

        alone = [pose(number) for number in range(THREADS)]
        for one, other in zip(at_once(pose), alone, strict=True):
            same_answer(one, other)

    @pytest.mark.slow
    def test_that_load_and_fit_models_of_several_categories_get_the_answers_that_they_get_alone(self):
        names = ("mug", "laptop", "bottle", "bowl", "can", "camera", "mug", "laptop")
        views = [seen(name, 3) for name in names]

        def pose(number: int) -> PoseResult:
            return kfit.load(names[number]).pose(views[number].image, mask=views[number].mask, seed=number)

        alone = [pose(number) for number in range(THREADS)]
        for one, other in zip(at_once(pose), alone, strict=True):
            same_answer(one, other)

    @pytest.mark.slow
    def test_that_cut_out_objects_get_the_masks_that_they_get_alone(self, photos):
        def cut(number: int) -> Any:
            return mask_from_box(photos[number].image, (4, 4, 88, 88))

        alone = [cut(number) for number in range(THREADS)]
        np.testing.assert_array_equal(at_once(cut), alone)

    def test_of_which_one_fails_leave_the_others_their_answers(self):
        fine, fit = blobs(), blobs(Fails(ZeroDivisionError, "load_3"))
        alone = [fine(blob(number), seed=number) for number in range(THREADS)]

        def one(number: int) -> FitResult | None:
            try:
                return fit(blob(number), seed=number)
            except ZeroDivisionError:
                return None

        found = at_once(one)
        assert sum(result is None for result in found) == 1
        for result, other in zip(found, alone, strict=True):
            if result is not None:
                same_history(result, other)

    def test_that_read_photos_leave_the_warnings_filters_as_they_were(self, photos, tmp_path):
        large = Image.fromarray((255 * photos[0].image).astype(np.uint8)).resize((600, 600))
        large.save(tmp_path / "photo.png")
        before, alone = list(warnings.filters), read_photo(tmp_path / "photo.png").image
        for image in at_once(lambda _: [read_photo(tmp_path / "photo.png").image for _ in range(5)]):
            np.testing.assert_array_equal(image[-1], alone)
        assert warnings.filters == before

    def test_that_write_reports_write_those_that_they_write_alone(self, mug, photos, tmp_path):
        result = mug.pose(photos[0].image, mask=photos[0].mask, pipeline=mug.pipeline(2, 1))
        alone, before = kfit.report(result, tmp_path / "alone.html").read_text(), dict(matplotlib.rcParams)
        for page in at_once(lambda number: kfit.report(result, tmp_path / f"{number}.html").read_text(), 3):
            assert page == alone
        assert dict(matplotlib.rcParams) == before

    def test_and_whoever_called_keep_gradients_and_number_of_threads(self, mug, photos):
        before = torch.is_grad_enabled(), torch.get_num_threads(), torch.is_inference_mode_enabled()
        state = torch.random.get_rng_state()
        mug.pose(photos[0].image, mask=photos[0].mask, pipeline=mug.pipeline(1, 0))
        assert (torch.is_grad_enabled(), torch.get_num_threads(), torch.is_inference_mode_enabled()) == before
        assert torch.equal(torch.random.get_rng_state(), state)


class Terminal(io.StringIO):
    """Stands for stderr where it is a terminal."""

    def isatty(self) -> bool:
        return True


class TestAnInterrupt:
    def test_leaves_the_pipeline_as_it_was(self):
        fit = blobs()
        expected = fit(blob(1), seed=1)
        fit.callbacks.append(Fails(KeyboardInterrupt))
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                fit(blob(2), seed=2)
        fit.callbacks.pop()
        assert torch.is_grad_enabled()
        same_history(fit(blob(1), seed=1), expected)

    def test_gives_the_terminal_its_cursor_back(self, monkeypatch):
        shown = Terminal()
        monkeypatch.setattr(sys, "stderr", shown)
        monkeypatch.setenv("TERM", "xterm")
        fit = blobs(Progress(), Fails(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            fit(blob(2), seed=2)
        del fit
        gc.collect()
        hidden, back = shown.getvalue().rfind("\x1b[?25l"), shown.getvalue().rfind("\x1b[?25h")
        assert 0 <= hidden < back


def _pose_elsewhere(model: CategoryModel, photo: Any, told: Any) -> None:
    result = model.pose(photo.image, mask=photo.mask, seed=3)
    told.put((result.rotation, result.energy))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")
def test_a_forked_process_does_not_wait_for_threads_of_its_parent():
    fit, seen, before = blobs(), blob(1), torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        expected = fit(seen, seed=1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that threads are not forked along
            process = os.fork()
        if process == 0:
            status = 1
            try:
                same = torch.allclose(fit(seen, seed=1).history.energy, expected.history.energy, equal_nan=True)
                status = 0 if same else 2
            finally:
                os._exit(status)
    finally:
        torch.set_num_threads(before)
    end = threading.Timer(60, os.kill, (process, signal.SIGKILL))
    end.start()
    _, status = os.waitpid(process, 0)
    end.cancel()
    assert status == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fork", "spawn"])
def test_a_worker_process_gives_the_same_answer_and_does_not_hang(kind, mug, photos):
    here = mug.pose(photos[3].image, mask=photos[3].mask, seed=3)
    context = multiprocessing.get_context(kind)
    told = context.Queue()
    worker = context.Process(target=_pose_elsewhere, args=(mug, photos[3], told), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads are not forked along
        worker.start()
    try:
        rotation, energy = told.get(timeout=120)
    finally:
        worker.kill()
        worker.join()
    np.testing.assert_allclose(rotation, here.rotation, atol=1e-4)
    assert energy == pytest.approx(here.energy, rel=1e-4)
