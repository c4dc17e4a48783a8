"""The answer's way through a fit, drawn step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.pose import PoseResult

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class FitFrames:
    """What the start that won drew at each step.

    Attributes:
        observed: (S, S, 3) RGB bytes, the crop that was to be explained.
        drawings: (T, S, S, 3) RGB bytes, from the start to the step after the last.
        energy: (T,) that was descended.
        terms: (T,) each, unweighted; NaN where one was not computed.
        answer: the step whose drawing is the answer.
    """

    observed: Picture
    drawings: Picture
    energy: list[float]
    terms: dict[str, list[float]]
    answer: int


def fit_frames(result: PoseResult) -> FitFrames:
    """Draw the winner's values at all steps, in one call of the generator.

    Args:
        result: result for a photo.

    Raises:
        ValueError: if not every step was recorded.
    """
    fit, history = result.fit, result.fit.history
    if history.value_stride != 1:
        raise ValueError("result must come from a fit that recorded the values of every step, with history=True")
    start = int(fit.start[0])
    there = history.energy[:, 0, start].isfinite()  # frozen starts are not evaluated again
    path = {name: value[there, 0, start] for name, value in history.values.items()}
    same = [(value == fit.values[name]).reshape(len(value), -1).all(1) for name, value in path.items()]
    return FitFrames(
        observed=picture_of(result.observation.field("image")[0]),
        drawings=np.stack([picture_of(image) for image in result.draw(path).image]),
        energy=history.energy[there, 0, start].tolist(),
        terms={name: term[there, 0, start].tolist() for name, term in history.terms.items()},
        answer=int(torch.stack(same).all(0).nonzero()[0, 0]),
    )


def picture_of(image: Tensor) -> Picture:
    """RGB bytes (H, W, 3) of a picture (3, H, W) in [0, 1]."""
    pixels: Picture = (255 * image.detach().cpu().float().clamp(0, 1)).round().byte().movedim(0, -1).numpy()
    return np.ascontiguousarray(pixels)
