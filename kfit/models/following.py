"""Following one object from frame to frame of a video, faster than frames are fitted one by one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Angle, Generator, Initializer, Observation, Positive, Rendering, Variable, Variables, frozen
from kfit.energies import PosePrior
from kfit.generators import SimilarityWarp
from kfit.generators.similarity_warp import warp
from kfit.geometry import Crop
from kfit.initializers import PosePosterior
from kfit.models.category_model import CategoryModel, usual_energies
from kfit.models.given import as_photo, choose_mask
from kfit.models.pose_result import PoseResult
from kfit.optimizers import GaussNewton
from kfit.pipeline import FitPipeline
from kfit.segmentation import Photo, mask_near, read_photo

# Of differences in roll, shift and scale, in raw units: a degree and a third of a pixel.
LENGTHS = {"roll": 0.006, "shift": 0.01, "scale": 0.01}
STEPS = 2
# Side of the picture in which the mask is looked for, how much larger than the crop it is, and the band about the
# silhouette in its pixels: where the last one was good, and where it was not.
GRID, WIDER, BAND, WIDE_BAND = 96, 1.3, 5, 9
INVERSE = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
# Overlap of drawing and mask below which the object is looked for anew, and above which a mask is held to be good.
LOST, GOOD = 0.6, 0.85
# Times the usual energy above which it is, too, and how fast what is usual follows.
UNUSUAL, LEARNING = 2.0, 0.2
# Share of the last motion in what is expected of the next.
MOMENTUM = 0.5


@dataclass(frozen=True)
class Followed:
    """Where the object is in one frame.

    Attributes:
        rotation: (3, 3), object (NOCS axes, y up) to camera (OpenCV: x right, y down, z forward).
        translation: (3,) of the object's centre, in metres, by the category's mean size.
        size: (3,) sides of the object's box, in metres.
        energy: by which the pose was chosen; lower is better.
        overlap: intersection over union of drawing and mask, in [0, 1]; low where the object is about to be lost.
        anew: whether the frame was fitted from nothing: the first, and those where the object was lost.
        intrinsics: (3, 3).
        mask: (H, W) that was used.
        crop: the square that was compared.
        drawing: (S, S, 3), the picture that explains it.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    size: NDArray[np.float64]
    energy: float
    overlap: float
    anew: bool
    intrinsics: NDArray[np.float64] = field(repr=False)
    mask: NDArray[np.float32] = field(repr=False)
    crop: Crop = field(repr=False)
    drawing: NDArray[np.float32] = field(repr=False)


def follow(
    model: CategoryModel,
    frames: Iterable[str | Path | Photo | NDArray[Any]],
    masks: Iterable[NDArray[Any]] | None = None,
    seed: int = 0,
    **first: Any,
) -> Iterator[Followed]:
    """Poses of one object in the frames of a video, one after another.

    The first frame is fitted by `CategoryModel.pose`. In the others the code is held; the pose is the more likely of
    the last one, moved on as it moved before, and of what the pose head reads off the frame; roll, shift and scale
    then follow by Gauss–Newton on the one drawing. The mask is the one given, else what stands out about the last
    drawing's silhouette (`kfit.segmentation.mask_near`). Where drawing and mask no longer overlap, or the energy has
    doubled, the frame is fitted from nothing in the box where the object should be.

    Args:
        model: with a pose head.
        frames: as `CategoryModel.pose` takes photos, all of one size and camera.
        masks: (H, W) of every frame, above 0 on the object.
        seed: decides the random numbers.
        first: what else `CategoryModel.pose` is to know of the first frame: ``mask``, ``box``, ``intrinsics``,
            ``segmenter``; ``intrinsics`` hold for all.

    Raises:
        ValueError: for a model without a pose head, or frames or masks that cannot be used.
    """
    given = iter(masks) if masks is not None else None
    follower: Follower | None = None
    for frame in frames:
        mask = None if given is None else next(given, None)
        if given is not None and mask is None:
            raise ValueError("masks: there are fewer than frames")
        if follower is None:
            result = model.pose(frame, **{**first, **({} if mask is None else {"mask": mask})}, seed=seed)
            follower = Follower(model, result, seed)
            yield follower.last
        else:
            yield follower(frame, mask)


class Follower:
    """What `follow` knows of the object from frame to frame; hand it the frames one by one, as they come.

    Args:
        model: with a pose head.
        first: its answer to the first frame.
        seed: decides the random numbers where the object must be looked for anew.

    Attributes:
        last: where the object was in the last frame.
        num_drawn: pictures drawn in frames that were followed.
    """

    def __init__(self, model: CategoryModel, first: PoseResult, seed: int = 0) -> None:
        if model.pose_head is None:
            raise ValueError(f"follow: the model of {model.card.category} has no pose head, which following rests on")
        self.model, self.seed, self.num_drawn = model, seed, 0
        self.head = frozen(model.pose_head)
        self._start(first)

    def _start(self, first: PoseResult) -> None:
        values = first.fit.values
        self.code, self.size = values["code"], first.size
        self.values = {name: values[name].clone() for name in ("azimuth", "elevation", "roll", "shift", "scale")}
        self.motion = {name: torch.zeros_like(self.values[name]) for name in ("azimuth", "elevation", "roll")}
        self.crop, self.drift = first.crop, (0.0, 0.0, 1.0)
        self.camera = torch.from_numpy(first.intrinsics)
        self.bound = frozen(self.model.generator).bind(code=self.code[0])
        energies = usual_energies()
        self.proposals = _Proposals()
        self.rank = FitPipeline(
            SimilarityWarp(self.bound),
            {**{name: energy for name, (energy, _) in energies.items()}, "pose": PosePrior(self.head)},
            [self.proposals],
            GaussNewton({**dict.fromkeys(self.motion, 0.01), **LENGTHS}),
            weights={**{name: weight for name, (_, weight) in energies.items()}, "pose": self.model.card.pose_weight},
            num_starts=2,
            num_steps=0,
        )
        squares = {name: energies[name] for name in ("perceptual", "silhouette")}
        self.place = FitPipeline(
            _Drawn(),
            {name: energy for name, (energy, _) in squares.items()},
            [_Proposals(("roll", "shift", "scale"))],
            GaussNewton(LENGTHS),
            weights={name: weight for name, (_, weight) in squares.items()},
            num_starts=1,
            num_steps=STEPS,
        )
        self.usual = first.energy
        self.last = self._told(first.energy, first.mask, first.observation, self._drawn(), anew=True)

    def __call__(self, frame: str | Path | Photo | NDArray[Any], mask: NDArray[Any] | None = None) -> Followed:
        """Find the object in the next frame.

        Args:
            frame: as large as the ones before.
            mask: (H, W), above 0 on the object; else it is found.

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
        if mask is not None:
            found = choose_mask(pixels, mask, None, None, None, self.model.card.category, [])
        else:
            nearby = self._nearby(pixels)
            if nearby is None:
                return self._anew(pixels)
            found = nearby
        before = self.crop
        self.crop = Crop.around(found, self.model.image_size)
        self.drift = (
            self.crop.centre[0] - before.centre[0],
            self.crop.centre[1] - before.centre[1],
            self.crop.side / before.side,
        )
        seen = self.crop.cut(pixels, found)
        energy = self._pose(seen)
        drawn = self._placed(seen)
        self.last = self._told(energy, found, seen, drawn, anew=False)
        lost = self.last.overlap < LOST or energy > UNUSUAL * self.usual
        self.usual += LEARNING * (min(energy, UNUSUAL * self.usual) - self.usual)
        return self._anew(pixels) if mask is None and lost else self.last

    def _pose(self, seen: Observation) -> float:
        """Choose azimuth and elevation; the least energy."""
        moved = self.values | {name: self.values[name] + self.motion[name] for name in self.motion}
        read = PosePosterior(self.head)({}, seen, 1, [])
        told = self.values | {name: read[name].to(self.values[name]) for name in ("azimuth", "elevation")}
        self.proposals.values = {name: torch.cat([moved[name], told[name]]) for name in moved}
        best = self.rank(seen, seed=0)
        self.num_drawn += 3  # the two, and the winner once more
        for name in self.motion:
            step = _wrapped(best.values[name] - self.values[name])
            self.motion[name] = MOMENTUM * (self.motion[name] + step)
        self.values = dict(best.values)
        return float(best.energy[0])

    def _placed(self, seen: Observation) -> Rendering:
        """Fit roll, shift and scale of the one drawing, and what it is then."""
        drawn = self._drawn()
        self.place.generator.drawn = drawn  # type: ignore[assignment]
        own = {name: self.values[name] for name in LENGTHS}
        self.place.initializers[0].values = own  # type: ignore[attr-defined]
        self.values |= self.place(seen, seed=0).values
        return drawn

    def _drawn(self) -> Rendering:
        with torch.no_grad():
            drawn: Rendering = self.bound(azimuth=self.values["azimuth"], elevation=self.values["elevation"])
        return drawn

    def _told(
        self, energy: float, mask: NDArray[np.float32], seen: Observation, drawn: Rendering, anew: bool
    ) -> Followed:
        """The answer, and what the next frame begins with."""
        own = {name: self.values[name] for name in LENGTHS}
        with torch.no_grad():
            picture = warp(drawn, **own)
            self.silhouette = picture.field("mask")[0, 0]
            away = self.silhouette.minimum(seen.field("mask")[0, 0]).sum()
            overlap = away / self.silhouette.maximum(seen.field("mask")[0, 0]).sum()
            rotation, translation, _ = self.model.placed(self.values, self.crop, self.camera)
        return Followed(
            rotation[0].numpy(),
            translation[0].numpy(),
            self.size,
            energy,
            float(overlap),
            anew,
            self.camera.double().numpy(),
            mask,
            self.crop,
            picture.image[0].movedim(0, -1).numpy(),
        )

    def _nearby(self, pixels: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """The mask about where the silhouette should be."""
        self.crop = self._expected()
        wide = replace(self.crop, side=WIDER * self.crop.side, size=GRID)
        to_photo = wide.crop_to_image.numpy()[:2]
        height, width = pixels.shape[:2]
        region = cv2.warpAffine(
            pixels,
            to_photo,
            (GRID, GRID),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        from_drawing = (self.crop.image_to_crop @ wide.crop_to_image).numpy()[:2]
        drawn = cv2.warpAffine(self.silhouette.numpy(), from_drawing, (GRID, GRID), flags=INVERSE)
        found = mask_near(region, drawn, BAND if self.last.overlap > GOOD else WIDE_BAND)
        if found is None:
            return None
        mask = cv2.warpAffine(found.astype(np.float32), to_photo, (width, height), flags=cv2.INTER_LINEAR)
        return mask if (mask > 0.5).any() else None

    def _expected(self) -> Crop:
        """The crop, had the object moved as it did last."""
        (x, y), (right, down, larger) = self.crop.centre, self.drift
        return replace(self.crop, centre=(x + right, y + down), side=self.crop.side * larger)

    def _anew(self, pixels: NDArray[np.float32]) -> Followed:
        """Fit the frame from nothing, in the box where the object should be."""
        left, top = (middle - self.crop.side / 2 for middle in self.crop.centre)
        box = (left, top, self.crop.side, self.crop.side)
        try:
            self._start(self.model.pose(pixels, box=box, intrinsics=self.camera, seed=self.seed))
        except ValueError:  # nothing stands out there; perhaps it will in the next
            self.last = replace(self.last, overlap=0.0, anew=False)
        return self.last


class _Proposals(Initializer):
    """Starts at what it is told."""

    def __init__(self, on: Sequence[str] = ("azimuth", "elevation", "roll", "shift", "scale")) -> None:
        self.on = tuple(on)
        self.values: Variables = {}

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        return self.values


class _Drawn(Generator):
    """One picture, turned, shifted and scaled."""

    drawn: Rendering

    def __init__(self) -> None:
        super().__init__()
        self.variables = {
            "roll": Variable((), Angle()),
            "shift": Variable((2,)),
            "scale": Variable((), Positive()),
        }

    def forward(self, **values: Tensor) -> Rendering:
        return warp(self.drawn, values["roll"], values["shift"], values["scale"])


def _wrapped(angle: Tensor) -> Tensor:
    return (angle + math.pi) % (2 * math.pi) - math.pi
