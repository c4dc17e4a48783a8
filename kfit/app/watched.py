"""A fit that reports its progress: the best start's drawing after each step, then the answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Callback, FitState, Generator
from kfit.geometry import Crop
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
        silhouette: (S, S) in [0, 1], where the drawing shows the object; None if the generator draws no mask.
        crop: the square of the photo that it explains.
    """

    step: int
    num_steps: int
    num_starts: int
    energy: float
    drawing: NDArray[np.float32]
    silhouette: NDArray[np.float32] | None
    crop: Crop


class _Left(Exception):  # noqa: N818
    """Raised when the page was closed."""


class Watching(Callback):
    """Draws the best start at each step, for one problem.

    Args:
        generator: generator of the fit.
        observed: object that is fitted.
        report: called with each `Drawn`.
        left: once set, the fit breaks off at its next step.
    """

    def __init__(
        self, generator: Generator, observed: ObservedObject, report: Callable[[Drawn], None], left: Event
    ) -> None:
        self.generator, self.observed, self.report, self.left = generator, observed, report, left

    def on_step(self, state: FitState) -> FitState:
        if self.left.is_set():
            raise _Left
        if len(state.problem):
            best = int(state.best_energy.argmin())
            with torch.no_grad():
                rendering = self.generator(
                    **{name: rows[best : best + 1] for name, rows in state.best_values.items()},
                    **self.generator.prepare(self.observed.observation),
                )
            self.report(
                Drawn(
                    step=state.step,
                    num_steps=state.num_steps,
                    num_starts=len(state.problem),
                    energy=float(state.best_energy[best]),
                    drawing=_picture(rendering.image),
                    silhouette=None if rendering.mask is None else rendering.mask[0, 0].float().cpu().numpy(),
                    crop=self.observed.crop,
                )
            )
        return state


def watched(
    model: CategoryModel,
    photo: Photo,
    target: FoundObject,
    intrinsics: NDArray[np.float64] | None = None,
    depth: NDArray[np.float32] | None = None,
) -> Iterator[Drawn | PoseResult]:
    """Run the fit of `kfit pose` in another thread: yield one `Drawn` a step, then the result.

    Whoever stops iterating ends the fit.

    Args:
        model: model of the object's category.
        photo: the photo.
        target: the object in it.
        intrinsics, depth: as `kfit.pose.CategoryModel.pose` takes them.

    Raises:
        ValueError, FitError: as `kfit.pose.CategoryModel.pose`.
    """
    events: SimpleQueue[Drawn | PoseResult | BaseException] = SimpleQueue()
    left = Event()
    inputs: dict[str, Any] = {"intrinsics": intrinsics, "depth": depth}
    observed = ObservedObject.of(photo, model.card.known, model.image_size, segmenter=target, **inputs)
    pipeline = model.pipeline(depth=depth is not None, lens_known=observed.lens_known)
    watching = Watching(pipeline.generator, observed, events.put, left)

    def fit() -> None:
        try:
            events.put(pose_of(model, photo, target, pipeline=pipeline, callbacks=[watching], **inputs))
        except BaseException as error:  # any error is passed to the waiting thread
            events.put(error)

    thread = Thread(target=fit, daemon=True)
    thread.start()
    try:
        while True:
            news = events.get()
            if isinstance(news, BaseException):
                raise news
            yield news
            if isinstance(news, PoseResult):
                return
    finally:
        left.set()
        thread.join()


def _picture(images: Tensor) -> NDArray[np.float32]:
    picture: NDArray[np.float32] = images[0].movedim(0, -1).float().clamp(0, 1).cpu().numpy()
    return picture
