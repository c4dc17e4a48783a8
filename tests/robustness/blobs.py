"""A small thing to fit, and threads that begin together."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch

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
from kfit.energies import L2
from kfit.fitting.pipeline import FitPipeline
from kfit.initializers import Uniform
from kfit.optimizers import Adam
from kfit.pose import PoseResult

THREADS = 8


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


# What sums in another order make of a fit's numbers by its end.
ROUNDING = {"energy": 5e-3, "code": 0.1, "azimuth": 1e-2, "elevation": 1e-2, "roll": 1e-2, "shift": 1e-2, "scale": 1e-2}


def same_history(one: FitResult, other: FitResult, within: Mapping[str, float] | None = None) -> None:
    """The same in every step: to the last bit, or within some numbers by name."""
    mine, theirs = ({"energy": fit.history.energy, **fit.history.values} for fit in (one, other))
    assert mine.keys() == theirs.keys()
    for name, path in mine.items():
        away = (within or {}).get(name, 0.0)
        torch.testing.assert_close(path, theirs[name], rtol=away, atol=away, equal_nan=True)
    assert one.start.tolist() == other.start.tolist()
    assert one.num_evaluations == other.num_evaluations


def same_answer(one: PoseResult, other: PoseResult) -> None:
    """The same to rounding: of several threads PyTorch may split sums otherwise than it does for one."""
    same_history(one.fit, other.fit, ROUNDING)
    np.testing.assert_allclose(one.rotation, other.rotation, atol=5e-3)
    np.testing.assert_allclose(one.translation, other.translation, atol=5e-3)
    np.testing.assert_array_equal(one.mask, other.mask)


def at_once(work: Callable[[int], Any], count: int = THREADS) -> list[Any]:
    """What threads find that begin together; tasks have threads of their own."""
    begin = threading.Barrier(count)

    def one(number: int) -> Any:
        begin.wait()
        return work(number)

    with ThreadPoolExecutor(count, "load") as pool:
        return list(pool.map(one, range(count)))


def view_of(category: str, number: int) -> Any:
    mesh, light = build(category, number)
    return pose_view(mesh, 0.5, 0.3 * number, light, 96)
