"""Tracking of one object from frame to frame."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Observation, Rendering, Variables, frozen
from kfit.core.arguments import check_arguments
from kfit.energies import PosePrior
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import SimilarityWarp
from kfit.generators.similarity_warp import warp
from kfit.geometry import Crop
from kfit.initializers import Constant, PosePosterior
from kfit.optimizers import GaussNewton
from kfit.pose.category_model import CategoryModel
from kfit.pose.defaults import default_energies
from kfit.pose.inputs import as_numbers, as_photo, choose_mask
from kfit.pose.placement import placement
from kfit.pose.result import PoseResult
from kfit.segmentation import Photo, binary_mask, mask_in_photo, read_photo
from kfit.tracking.fixed_rendering import LENGTHS, moved_in_plane
from kfit.tracking.track_confidence import pose_head_of, track_confidence
from kfit.tracking.track_quality import GOOD_OVERLAP, TrackQuality
from kfit.tracking.tracked_pose import TrackedPose

Mask: TypeAlias = NDArray[np.float32]
# Width of the band around the silhouette in which the mask is segmented, as a fraction of the grid: after a good mask,
# and after a bad one.
BAND, WIDE_BAND = 0.05, 0.09
# Weight of the last motion in the extrapolation.
MOMENTUM = 0.5


class Tracker:
    """State of `track` between frames; call it with one frame after another.

    A frame's confidence comes from the model's calibration, with the two poses that are compared in place of a fit's
    starts, and the pose head's probability near the better one. It is at most 50 % if the frame is lost, if its mask
    differs from the drawing (an overlap below 0.85), if the energy is twice that of the last frame that was fitted from
    scratch, and in the five frames after a jump of 30°; it is 0 if no object is found.

    Args:
        model: with a pose head.
        first: its answer to the first frame.
        seed: determines the random numbers of fits from scratch.

    Attributes:
        last: pose of the object in the last frame.
        num_drawn: pictures drawn in tracked frames.

    Example:
        >>> import numpy as np, kfit
        >>> image, mask = np.ones((96, 96, 3)), np.zeros((96, 96))
        >>> image[20:80, 30:70], mask[20:80, 30:70] = (0.7, 0.2, 0.1), 1
        >>> model = kfit.load("mug")
        >>> from kfit.tracking import Tracker
        >>> first = model.pose(image, mask=mask, pipeline=model.pipeline(num_starts=1, num_steps=1))
        >>> tracker = Tracker(model, first)
        >>> pose = tracker(image, mask)
        >>> pose.found, tracker.last is pose
        (True, True)
    """

    def __init__(self, model: CategoryModel, first: PoseResult, seed: int = 0) -> None:
        check_arguments(Tracker, locals(), seed=(0,))
        head = pose_head_of(model)
        self.model, self.seed, self.num_drawn = model, seed, 0
        self.posterior, self.prior = PosePosterior(head), PosePrior(head)
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
            frame: image of the same size as the first.
            mask: (H, W), above one half on the object, empty if it is not visible; None segments it.

        Returns:
            The pose; if no object is found, the last pose with an overlap of 0.

        Raises:
            ValueError: if a frame or mask cannot be used.
        """
        if isinstance(frame, str | Path):
            frame = read_photo(frame)
        pixels = frame.image if isinstance(frame, Photo) else as_photo(frame)
        if pixels.shape[:2] != self.last.mask.shape:
            raise ValueError(f"frame must be as large as the first, {self.last.mask.shape}, got {pixels.shape[:2]}")
        if mask is not None and not binary_mask(as_numbers("mask", mask)).any():
            return self._not_found()
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
        """Choose azimuth and elevation; return the least energy and the confidence."""
        moved = self.values | {name: self.values[name] + self.motion[name] for name in self.motion}
        predicted = self.values | self._read(observation)
        starts = {name: torch.cat([moved[name], predicted[name]]) for name in moved}
        best = self.rank(observation, seed=0, starts=starts)
        self.num_drawn += 3  # both, and the winner again
        self.values = dict(best.values)
        return float(best.energy[0]), track_confidence(self.model, best, observation)

    def _read(self, observation: Observation) -> Variables:
        """Return the likeliest rotation of the pose head; roll is omitted if the head does not predict it."""
        start = self.posterior({}, observation, 1, [])
        return {
            name: value.to(self.values[name])
            for name, value in start.items()
            if name != "roll" or self.posterior.head.predicts_roll
        }

    def _placed(self, observation: Observation) -> Rendering:
        """Fit roll, shift and scale of the one drawing, and return the drawing."""
        drawn = self._drawn()
        self.values = self.values | moved_in_plane(drawn, self.values, observation)
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
        """Segment the mask around the silhouette, extrapolated from the last motion."""
        (x, y), (right, down, larger) = self.crop.centre, self.drift
        self.crop = replace(self.crop, centre=(x + right, y + down), side=self.crop.side * larger)
        band = BAND if self.last.overlap > GOOD_OVERLAP else WIDE_BAND
        return mask_in_photo(pixels, self.silhouette.numpy(), self.crop, band)

    def _anew(self, pixels: NDArray[np.float32]) -> TrackedPose:
        """Fit the frame from scratch, in the box where the object is expected."""
        left, top = (middle - self.crop.side / 2 for middle in self.crop.centre)
        box = (left, top, self.crop.side, self.crop.side)
        try:
            found = self.model.pose(pixels, box=box, intrinsics=self.camera, seed=self.seed)
        except ValueError:  # no object found in this frame
            return self._not_found()
        self._start(found, self.quality.fitted_anew(found.energy))
        return self.last

    def _not_found(self) -> TrackedPose:
        self.last = replace(self.last, overlap=0.0, confidence=0.0, lost=True, anew=False)
        return self.last


def _wrapped(angle: Tensor) -> Tensor:
    return (angle + math.pi) % (2 * math.pi) - math.pi
