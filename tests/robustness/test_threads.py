"""Threads and processes get the answers that they get alone, and what breaks off leaves nothing undone."""

from __future__ import annotations

import gc
import io
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from typing import Any

import matplotlib
import numpy as np
import pytest
import torch
from blobs import THREADS, Fails, at_once, blob, blobs, same_answer, same_history, view_of
from PIL import Image

import kfit
from kfit.callbacks import Progress, Pruning, Stopping
from kfit.core import (
    FitResult,
)
from kfit.energies import SSIM, Perceptual
from kfit.features import EfficientNetLite0
from kfit.pose import CategoryModel, PoseResult
from kfit.segmentation import mask_from_box, read_photo


class TestThreads:
    def test_that_share_a_pipeline_get_the_answers_that_they_get_alone(self):
        energies = {"image": SSIM(), "features": Perceptual(EfficientNetLite0((0,)))}
        fit = blobs(Pruning({1: 3}), Stopping(0.2, 1), energies=energies)
        alone = [fit(blob(number), seed=number) for number in range(THREADS)]
        assert len({result.num_evaluations for result in alone}) > 1  # some stop earlier
        for one, other in zip(at_once(lambda number: fit(blob(number), seed=number)), alone, strict=True):
            same_history(one, other)

    @pytest.mark.slow
    def test_that_share_a_model_get_the_answers_that_they_get_alone(self, mug, photos):
        fit = mug.pipeline(2, 1, [Pruning({0: 1})])

        def pose(number: int) -> PoseResult:
            selection = {"mask": photos[number].mask} if number > 1 else {"box": (4.0, 4.0, 88.0, 88.0)}
            return mug.pose(photos[number].image, **selection, seed=number, pipeline=fit)

        alone = [pose(number) for number in range(THREADS)]
        for one, other in zip(at_once(pose), alone, strict=True):
            same_answer(one, other)

    @pytest.mark.slow
    def test_that_load_and_fit_several_models_get_the_answers_that_they_get_alone(self):
        names = ("mug", "laptop", "bottle", "bowl", "can", "camera", "mug", "laptop")
        views = [view_of(name, 3) for name in names]

        def pose(number: int) -> PoseResult:
            model, view = kfit.load(names[number]), views[number]
            return model.pose(view.image, mask=view.mask, seed=number, pipeline=model.pipeline(2, 2))

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

    @pytest.mark.slow
    def test_that_write_reports_write_those_that_they_write_alone(self, mug, photos, tmp_path):
        result = mug.pose(photos[0].image, mask=photos[0].mask, pipeline=mug.pipeline(2, 1))
        alone, before = kfit.report(result, tmp_path / "alone.html").read_text(), dict(matplotlib.rcParams)
        for page in at_once(lambda number: kfit.report(result, tmp_path / f"{number}.html").read_text(), 3):
            assert page == alone
        assert dict(matplotlib.rcParams) == before

    @pytest.mark.slow
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
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                fit(blob(2), seed=2, callbacks=[Fails(KeyboardInterrupt)])
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


def _pose_elsewhere(model: CategoryModel, photo: Any, answers: Any) -> None:
    result = model.pose(photo.image, mask=photo.mask, seed=3)
    answers.put((result.rotation, result.energy))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")
def test_a_forked_process_does_not_wait_for_threads_of_its_parent():
    fit, observed, before = blobs(), blob(1), torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        expected = fit(observed, seed=1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that threads are not forked along
            process = os.fork()
        if process == 0:
            status = 1
            try:
                kept = torch.get_num_threads() == 2  # importing kfit changes nothing of the caller's
                same = torch.allclose(fit(observed, seed=1).history.energy, expected.history.energy, equal_nan=True)
                status = 0 if same and kept and torch.get_num_threads() == 2 else 2
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
    answers = context.Queue()
    worker = context.Process(target=_pose_elsewhere, args=(mug, photos[3], answers), daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that threads are not forked along
        worker.start()
    try:
        rotation, energy = answers.get(timeout=120)
    finally:
        worker.kill()
        worker.join()
    np.testing.assert_allclose(rotation, here.rotation, atol=5e-3)
    assert energy == pytest.approx(here.energy, rel=5e-3)
