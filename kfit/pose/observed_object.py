"""An object in a photo, prepared for a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Observation
from kfit.geometry import Category, Crop, observed
from kfit.geometry.crop import MARGIN
from kfit.pose.inputs import as_depth, as_ignored, as_photo, choose_camera, choose_mask
from kfit.pose.object_depth import object_depth
from kfit.segmentation import Photo, Segmenter, load_segmenter, mask_from_alpha, read_photo

# Notes that limit an answer's confidence.
PLAIN = "the object has one colour: only its outline shows its pose, and the confidence is 50 % at most"
WHOLE = "the mask covers the whole picture: there is no outline, and the confidence is 50 % at most"
_LEAST_DEVIATION = 0.01
# A pixel of the picture counts where a smaller share of it is ignored.
MOST_IGNORED = 0.25


@dataclass(frozen=True)
class ObservedObject:
    """The observation of one object, and its place in the photo.

    Attributes:
        observation: one problem for a `kfit.FitPipeline`.
        image: (H, W, 3) RGB in [0, 1], the whole photo.
        mask: (H, W) that was used.
        crop: the square of the observation.
        intrinsics: (3, 3) of the photo; if unknown, with the likeliest focal length of lenses.
        intrinsics_from: "given", "EXIF" or "estimated"; an estimated focal length is fitted.
        notes: sentences on assumptions, and on objects that are cut off or small.
        doubtful: whether one of them limits the answer's confidence to 50 %.
    """

    observation: Observation
    image: NDArray[np.float32]
    mask: NDArray[Any]
    crop: Crop
    intrinsics: Tensor
    intrinsics_from: str
    notes: tuple[str, ...]
    doubtful: bool = False

    @property
    def lens_known(self) -> bool:
        """Whether the focal length is known, so that a fit need not find it."""
        return self.intrinsics_from != "estimated"

    @staticmethod
    def of(
        image: str | Path | Photo | NDArray[Any],
        category: Category,
        size: int,
        mask: NDArray[Any] | None = None,
        box: tuple[float, float, float, float] | None = None,
        intrinsics: NDArray[Any] | Tensor | None = None,
        depth: NDArray[Any] | None = None,
        segmenter: str | Path | Segmenter | None = None,
        ignore: NDArray[Any] | None = None,
    ) -> ObservedObject:
        """Find the object and cut it out, as `kfit.pose.CategoryModel.pose` describes.

        Args:
            image, mask, box, intrinsics, depth, segmenter, ignore: as there.
            category: category of the object; segmenters use its name.
            size: size of the picture in pixels.

        Raises:
            FileNotFoundError, ValueError: if an input cannot be used, in one sentence.
        """
        notes: list[str] = []
        warnings: list[str] = []
        alpha, known, camera_notes = None, None, tuple[str, ...]()
        if isinstance(image, str | Path | Photo):
            photo = image if isinstance(image, Photo) else read_photo(image)
            pixels, known, camera_notes = photo.image, photo.intrinsics, photo.camera_notes
            alpha = None if photo.alpha is None else mask_from_alpha(photo.alpha)
        else:
            pixels = as_photo(image)
        if isinstance(segmenter, str | Path):
            segmenter = load_segmenter(segmenter)
        segment = choose_mask(pixels, mask, box, alpha, segmenter, category.name)
        hidden = None if ignore is None else as_ignored(ignore, segment.mask)
        found = segment.mask if hidden is None else segment.mask * (1 - hidden)
        notes += segment.notes
        warnings += segment.warnings
        camera, came_from = choose_camera(pixels, intrinsics, known, notes, warnings)
        notes += camera_notes if came_from == "EXIF" else ()
        crop = Crop.around(found, size)
        notes += [note for note in (cut_off(found), too_small(crop)) if note is not None]
        of_object = None
        if depth is not None:
            away = as_depth(depth, found.shape)
            of_object, noted, doubted = object_depth(away, found, camera.double(), category)
            notes += noted
            warnings += doubted
        observation = observed(crop, pixels, found, of_object, camera.double())
        if hidden is not None and hidden.any():
            part = crop.cut(pixels, hidden).field("mask")
            observation = replace(observation, weight=(part < MOST_IGNORED).to(part))
        if depth is not None and not bool(observation.field("depth").isfinite().any()):
            raise ValueError(f"depth is known at too few pixels of the object: none is left in its {size} x {size}")
        warnings += [PLAIN] * _is_plain(observation) + [WHOLE] * bool((found > 0.5).all())
        return ObservedObject(observation, pixels, found, crop, camera, came_from, (*notes, *warnings), bool(warnings))


def _is_plain(observation: Observation) -> bool:
    """Return whether the object's colours, each in [0, 1], have a standard deviation below 0.01."""
    colors = observation.field("image")[0].flatten(1)[:, observation.field("mask")[0, 0].flatten() > 0.9]
    return colors.shape[1] > 1 and float(colors.std(1).max()) < _LEAST_DEVIATION


def cut_off(mask: NDArray[Any]) -> str | None:
    """Return a sentence if an object's mask (H, W) touches the picture's border."""
    edges = {"left": mask[:, 0], "right": mask[:, -1], "top": mask[0], "bottom": mask[-1]}
    touched = [name for name, edge in edges.items() if bool((np.asarray(edge) > 0.5).any())]
    if not touched:
        return None
    where = " and ".join(filter(None, [", ".join(touched[:-1]), touched[-1]]))
    return (
        f"the mask touches the picture's border ({where}): the object may be cut off, and what lies outside is taken "
        "for background"
    )


def too_small(crop: Crop) -> str | None:
    """Return a sentence if the photo has fewer pixels of an object than the generator draws."""
    if crop.side >= crop.size:
        return None
    box, needed = crop.side / MARGIN, crop.size / MARGIN
    return (
        f"the object is small: the longer side of its box has {box:.0f} pixels, and the drawing that is fitted to it "
        f"{needed:.0f}; its details are lost"
    )
