"""Following one object from frame to frame."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import FitResult, Observation, Rendering, Variables, frozen
from kfit.core.check import check_count
from kfit.energies import L2, PosePrior, Silhouette
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import SimilarityWarp
from kfit.generators.similarity_warp import warp
from kfit.geometry import Crop
from kfit.initializers import Constant, PosePosterior
from kfit.optimizers import GaussNewton
from kfit.pose.category_model import CategoryModel
from kfit.pose.confidence import DOUBTFUL, evidence
from kfit.pose.defaults import default_energies
from kfit.pose.hypotheses import alternatives, head_probability
from kfit.pose.inputs import as_numbers, as_photo, choose_mask
from kfit.pose.placement import placement
from kfit.pose.result import PoseResult
from kfit.segmentation import Photo, binary_mask, mask_in_photo, read_photo
from kfit.tracking.fixed_rendering import FixedRendering
from kfit.tracking.track_quality import GOOD_OVERLAP, TrackQuality
from kfit.tracking.tracked_pose import TrackedPose

Mask: TypeAlias = NDArray[np.float32]
# Of differences in roll, shift and scale, in raw units: two degrees and two thirds of a pixel.
LENGTHS = {"roll": 0.012, "shift": 0.02, "scale": 0.02}
STEPS = 3
# About the silhouette, in shares of the grid in which the mask is looked for: after a good mask, and after a bad one.
BAND, WIDE_BAND = 0.05, 0.09
# Share of the last motion in what is expected of the next.
MOMENTUM = 0.5


class Tracker:
    """What `track` knows of the object from frame to frame; hand it the frames one by one, as they come.

    A frame's confidence is that of the model's calibration, by the two poses that are compared in it in place of a
    fit's starts, and the share of the pose head's probability near the better one. It is 50 % at most where the frame
    is lost, where its mask differs from the drawing (an overlap below 0.85), where the energy is twice that of the last
    frame that was fitted from nothing, and in the five frames after a jump of 30°; it is 0 where nothing is seen.

    Args:
        model: with a pose head.
        first: its answer to the first frame.
        seed: decides the random numbers where the object must be looked for anew.

    Attributes:
        last: where the object was in the last frame.
        num_drawn: pictures drawn in frames that were followed.
    """

    def __init__(self, model: CategoryModel, first: PoseResult, seed: int = 0) -> None:
        check_count("track: seed", seed, 0)
        if model.pose_head is None:
            raise ValueError(f"track: the model of {model.card.category} has no pose head, which following rests on")
        self.model, self.seed, self.num_drawn = model, seed, 0
        self.posterior, self.prior = PosePosterior(model.pose_head), PosePrior(model.pose_head)
        self.energies = default_energies()
        rotation, energy = torch.from_numpy(first.rotation), first.energy
        self._start(first, TrackQuality(model.card.known.symmetry, rotation, energy, energy))

    def _start(self, first: PoseResult, quality: TrackQuality) -> None:
        values = first.fit.values
        self.code, self.size = values["code"], first.size
        names = ("azimuth", "elevation", "roll", "shift", "scale", "focal")
        self.values = {name: values[name].clone() for name in names if name in values}
        self.motion = {name: torch.zeros_like(self.values[name]) for name in ("azimuth", "elevation", "roll")}
        self.crop, self.drift = first.crop, (0.0, 0.0, 1.0)
        self.camera = torch.from_numpy(first.intrinsics)
        self.bound = frozen(self.model.generator).bind(code=self.code[0])
        self.rank = FitPipeline(
            SimilarityWarp(self.bound),
            {**{name: energy for name, (energy, _) in self.energies.items()}, "pose": self.prior},
            [Constant({name: value[0].tolist() for name, value in self.values.items()})],
            GaussNewton(dict.fromkeys(self.values, 0.01)),
            weights={
                **{name: weight for name, (_, weight) in self.energies.items()},
                "pose": self.model.card.pose_weight,
            },
            num_starts=2,
            num_steps=0,
        )
        self.quality = quality
        drawn = self._drawn()
        self.last = self._answer(first.energy, first.confidence, first.mask, first.observation, drawn, anew=True)

    def __call__(self, frame: str | Path | Photo | NDArray[Any], mask: NDArray[Any] | None = None) -> TrackedPose:
        """Find the object in the next frame.

        Args:
            frame: as large as the ones before.
            mask: (H, W), above one half on the object, empty where it is not to be seen; else it is found.

        Returns:
            Where it is; where nothing stands out, where it was, with no overlap.

        Raises:
            ValueError: for a frame or mask that cannot be used.
        """
        if isinstance(frame, str | Path):
            frame = read_photo(frame)
        pixels = frame.image if isinstance(frame, Photo) else as_photo(frame)
        if pixels.shape[:2] != self.last.mask.shape:
            raise ValueError(f"frame must be as large as the first, {self.last.mask.shape}, got {pixels.shape[:2]}")
        if mask is not None and not binary_mask(as_numbers("mask", mask)).any():
            return self._unseen()
        if mask is not None:
            found = choose_mask(pixels, mask, None, None, None, self.model.card.category).mask
        else:
            nearby = self._nearby(pixels)
            if nearby is None:
                return self._anew(pixels)
            found = nearby
        before, values = self.last.crop, self.values
        self.crop = Crop.around(found, self.model.image_size)
        if "focal" in values:
            self.values = values | {"focal": values["focal"] * before.side / self.crop.side}
        self.drift = (
            self.crop.centre[0] - before.centre[0],
            self.crop.centre[1] - before.centre[1],
            self.crop.side / before.side,
        )
        observation = self.model.read(self.crop.cut(pixels, found))
        energy, confidence = self._pose(observation)
        drawn = self._placed(observation)
        for name in self.motion:
            self.motion[name] = MOMENTUM * (self.motion[name] + _wrapped(self.values[name] - values[name]))
        self.last = self._answer(energy, confidence, found, observation, drawn, anew=False)
        self.quality.learn(energy)
        return self._anew(pixels) if mask is None and self.last.lost else self.last

    def _pose(self, observation: Observation) -> tuple[float, float]:
        """Choose azimuth and elevation; the least energy, and the confidence."""
        moved = self.values | {name: self.values[name] + self.motion[name] for name in self.motion}
        predicted = self.values | self._read(observation)
        starts = {name: torch.cat([moved[name], predicted[name]]) for name in moved}
        best = self.rank(observation, seed=0, starts=starts)
        self.num_drawn += 3  # the two, and the winner once more
        self.values = dict(best.values)
        return float(best.energy[0]), self._confidence(best, observation)

    def _confidence(self, ranked: FitResult, observation: Observation) -> float:
        """What the model's calibration makes of the two poses that were compared and of the pose head's probability."""
        symmetry, head = self.model.card.known.symmetry, self.model.pose_head
        log_probability = self.model.pose_log_probabilities(observation)
        found = alternatives(ranked, torch.eye(3).double(), symmetry)
        near = None
        if head is not None and log_probability is not None:
            near = head_probability(ranked, log_probability[0], head, symmetry)
        calibration, features = self.model.card.calibration.get("RGB"), evidence(found, near)
        if calibration is None or not set(calibration.coefficients) <= set(features):
            return found[0].weight
        confidence = calibration.probability(features)
        return min(confidence, DOUBTFUL) if found[0].energy > calibration.energy_99 else confidence

    def _read(self, observation: Observation) -> Variables:
        """The likeliest rotation by the pose head; roll is left out where the head does not predict it."""
        start = self.posterior({}, observation, 1, [])
        return {
            name: value.to(self.values[name])
            for name, value in start.items()
            if name != "roll" or self.posterior.head.predicts_roll
        }

    def _placed(self, observation: Observation) -> Rendering:
        """Fit roll, shift and scale of the one drawing, and what it is then."""
        drawn = self._drawn()
        # Features are too rough for so long differences: with EfficientNet's, Gauss-Newton hardly moves.
        place = FitPipeline(
            SimilarityWarp(FixedRendering(drawn)),
            {"image": L2(), "silhouette": Silhouette()},
            [Constant({name: self.values[name][0].tolist() for name in LENGTHS})],
            GaussNewton(LENGTHS),
            num_starts=1,
            num_steps=STEPS,
        )
        self.values = self.values | place(observation, seed=0).values
        return drawn

    def _drawn(self) -> Rendering:
        fixed = {name: self.values[name] for name in ("azimuth", "elevation")}
        if "focal" in self.values:
            fixed["focal"] = self.values["focal"] / self.values["scale"]
        with torch.no_grad():
            return self.bound(**fixed)

    def _answer(
        self, energy: float, confidence: float, mask: Mask, observation: Observation, drawn: Rendering, anew: bool
    ) -> TrackedPose:
        """The answer, and what the next frame begins with."""
        own = {name: self.values[name] for name in LENGTHS}
        with torch.no_grad():
            picture = warp(drawn, **own)
            self.silhouette = picture.field("mask")[0, 0]
            away = self.silhouette.minimum(observation.field("mask")[0, 0]).sum()
            overlap = away / self.silhouette.maximum(observation.field("mask")[0, 0]).sum()
            rotation, translation, _ = placement(self.values, self.crop, self.camera, self.model.card)
        lost, confidence = self.quality.assess(energy, float(overlap), rotation[0], confidence)
        return TrackedPose(
            rotation[0].numpy(),
            translation[0].numpy(),
            self.size,
            energy,
            float(overlap),
            confidence,
            lost,
            anew,
            self.camera.double().numpy(),
            mask,
            self.crop,
            picture.image[0].movedim(0, -1).numpy(),
            self.silhouette.numpy(),
        )

    def _nearby(self, pixels: NDArray[np.float32]) -> Mask | None:
        """The mask about where the silhouette should be, had the object moved as it did last."""
        (x, y), (right, down, larger) = self.crop.centre, self.drift
        self.crop = replace(self.crop, centre=(x + right, y + down), side=self.crop.side * larger)
        band = BAND if self.last.overlap > GOOD_OVERLAP else WIDE_BAND
        return mask_in_photo(pixels, self.silhouette.numpy(), self.crop, band)

    def _anew(self, pixels: NDArray[np.float32]) -> TrackedPose:
        """Fit the frame from nothing, in the box where the object should be."""
        left, top = (middle - self.crop.side / 2 for middle in self.crop.centre)
        box = (left, top, self.crop.side, self.crop.side)
        try:
            found = self.model.pose(pixels, box=box, intrinsics=self.camera, seed=self.seed)
        except ValueError:  # nothing stands out there; perhaps it will in the next
            return self._unseen()
        self._start(found, self.quality.fitted_anew(found.energy))
        return self.last

    def _unseen(self) -> TrackedPose:
        self.last = replace(self.last, overlap=0.0, confidence=0.0, lost=True, anew=False)
        return self.last


def _wrapped(angle: Tensor) -> Tensor:
    return (angle + math.pi) % (2 * math.pi) - math.pi
