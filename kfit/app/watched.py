"""A fit that tells how it goes: the best start's drawing after each step, then the answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Event, Thread

import numpy as np
import torch
from numpy.typing import NDArray

from kfit.core import Callback, FitState, Generator
from kfit.fitting.pipeline import FitPipeline
from kfit.models.find_poses import pose_of
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.pose.observed_object import ObservedObject
from kfit.segmentation import Photo


@dataclass(frozen=True)
class Drawn:
    """How far a fit has come.

    Attributes:
        step, num_steps: taken and planned.
        num_starts: how many starts are still on their way.
        energy: the least so far.
        drawing: (S, S, 3) in [0, 1], of the start that reached it.
        seen: (S, S, 3), what it is to explain.
    """

    step: int
    num_steps: int
    num_starts: int
    energy: float
    drawing: NDArray[np.float32]
    seen: NDArray[np.float32]


class _Left(Exception):  # noqa: N818
    """Nobody looks any more."""


class Watching(Callback):
    """Draws the best start at each step, for one problem.

    Args:
        generator: of the fit.
        seen: (S, S, 3), what is fitted.
        tell: is handed each `Drawn`.
        left: once set, the fit breaks off at its next step.
    """

    def __init__(
        self, generator: Generator, seen: NDArray[np.float32], tell: Callable[[Drawn], None], left: Event
    ) -> None:
        self.generator, self.seen, self.tell, self.left = generator, seen, tell, left

    def on_step(self, state: FitState) -> FitState:
        if self.left.is_set():
            raise _Left
        if len(state.problem):
            best = int(state.best_energy.argmin())
            with torch.no_grad():
                image = self.generator(
                    **{name: rows[best : best + 1] for name, rows in state.best_values.items()}
                ).image
            drawing = image[0].movedim(0, -1).float().clamp(0, 1).cpu().numpy()
            energy = float(state.best_energy[best])
            self.tell(Drawn(state.step, state.num_steps, len(state.problem), energy, drawing, self.seen))
        return state


def watched(model: CategoryModel, photo: Photo, target: FoundObject) -> Iterator[Drawn | PoseResult]:
    """The fit of `kfit pose`, in a thread beside: one `Drawn` a step, at last the result.

    Whoever stops iterating ends the fit.

    Args:
        model: of the object's category.
        photo: that is looked at.
        target: the object in it.

    Raises:
        ValueError, FitError: as `kfit.pose.CategoryModel.pose`.
    """
    told: SimpleQueue[Drawn | PoseResult | BaseException] = SimpleQueue()
    left = Event()
    observed = ObservedObject.of(photo, model.card.category, model.image_size, segmenter=target)
    seen = observed.observation.image[0].movedim(0, -1).numpy()

    def pipeline(model: CategoryModel) -> FitPipeline:
        made = model.pipeline(lens_known=observed.lens_known)
        made.callbacks.append(Watching(made.generator, seen, told.put, left))  # type: ignore[arg-type]
        return made

    def fit() -> None:
        try:
            told.put(pose_of(model, photo, target, pipeline=pipeline))
        except BaseException as error:  # whatever it is, it is told to those who wait
            told.put(error)

    thread = Thread(target=fit, daemon=True)
    thread.start()
    try:
        while True:
            news = told.get()
            if isinstance(news, BaseException):
                raise news
            yield news
            if isinstance(news, PoseResult):
                return
    finally:
        left.set()
        thread.join()
