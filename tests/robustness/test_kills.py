"""kill -9 at random moments: nothing is lost but what was in flight, no file is half there, results stay the same.

Processes are forked from this one, which has imported everything, so that a kill hits the work. Each is repeated
KFIT_KILLS times, three unless said otherwise.
"""

from __future__ import annotations

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

from kfit.core.whole_files import PARTIAL
from kfit.data.views import build_views

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
        return build_views(path, "mug", 40, 2, image_size=24)

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
    processes = [start(lambda: build_views(path, "mug", 40, 2, image_size=24)) for _ in range(2)]
    assert [os.waitpid(process, 0)[1] for process in processes] == [0, 0]
    whole = arrays(build_views(tmp_path / "whole.h5", "mug", 40, 2, image_size=24))
    for name, array in arrays(path).items():
        np.testing.assert_array_equal(array, whole[name])
    assert [entry.name for entry in sorted(tmp_path.iterdir()) if not entry.name.startswith(PARTIAL)] == [
        "views.h5",
        "whole.h5",
    ]
