"""Steps that a network predicts from photo and drawing."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from kfit.core import Angle, Evaluate, Evaluation, Optimizer, Variables
from kfit.geometry import RefinerNetwork, angles_from_rotation, refiner_input, updated_rotation
from kfit.geometry.pose import rotation_of

MOVED = ("azimuth", "elevation", "roll", "shift", "scale")


class LearnedSteps(Optimizer):
    """Moves azimuth, elevation, roll, shift and scale as a network predicts from the photo and the drawing.

    No gradient is computed, and other variables stay as they are. One drawing a step; a few steps from a start up to
    30° off lead near the object, where a descent can continue:
    ``Stages([(LearnedSteps(refiner), 3), (Adam(), 13)])``.

    Args:
        refiner: sees photo and drawing and predicts the update, as `kfit.features.PoseRefiner`.

    Raises:
        ValueError: when a fit starts, for a generator without one of these variables; in a step, where the drawing or
            the observation has no mask, or a problem has several views.

    Example:
        >>> from kfit.features import PoseRefiner
        >>> from kfit.optimizers import Adam, Stages
        >>> Stages([(LearnedSteps(PoseRefiner(None)), 3), (Adam(0.02), 13)]).stages[0]
        (LearnedSteps(refiner=<PoseRefiner>), 3)
    """

    def __init__(self, refiner: RefinerNetwork) -> None:
        self.refiner = refiner

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        missing = [name for name in MOVED if name not in raw]
        if missing:
            raise ValueError(f"LearnedSteps needs the variables {', '.join(MOVED)}; {', '.join(missing)} is missing")
        return None

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="pictures")
        drawn, observed = evaluation.rendering, evaluation.observed
        if drawn is None or drawn.mask is None or "mask" not in observed:
            raise ValueError("LearnedSteps needs masks, both drawn and observed")
        if len(drawn.image) != len(problem):
            raise ValueError("LearnedSteps needs one picture of each problem, got several views")
        weight = observed.get("weight")
        with torch.no_grad(), torch.autocast(problem.device.type, enabled=False):
            update = self.refiner(
                refiner_input(observed["image"], observed["mask"], weight),
                refiner_input(drawn.image, drawn.mask, weight),
            )
            angles = angles_from_rotation(
                updated_rotation(rotation_of(evaluation.values), update.rotation.to(drawn.image))
            )
        step = {name: torch.zeros_like(value) for name, value in raw.items()}
        for name, angle in zip(("azimuth", "elevation", "roll"), angles, strict=True):
            # The short way round.
            change = torch.remainder(angle - evaluation.values[name] + math.pi, 2 * math.pi) - math.pi
            step[name] = change / Angle.radians
        step["shift"], step["scale"] = update.shift.to(step["shift"]), update.log_scale.to(step["scale"])
        return evaluate.retract(raw, step), evaluation, memory
