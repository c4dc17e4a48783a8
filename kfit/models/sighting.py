"""An object in a photo, made ready to be fitted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Observation
from kfit.geometry import Crop, observed
from kfit.models.given import as_photo, choose_camera, choose_depth, choose_mask
from kfit.segmentation import Photo, Segmenter, load_segmenter, mask_from_alpha, read_photo


@dataclass(frozen=True)
class Sighting:
    """What is seen of one object, and where.

    Attributes:
        observation: one problem for a `kfit.FitPipeline`.
        mask: (H, W) that was used.
        crop: the square that the observation shows.
        intrinsics: (3, 3) of the photo.
        intrinsics_from: "given", "EXIF" or "assumed".
        notes: sentences on what was assumed.
    """

    observation: Observation
    mask: NDArray[Any]
    crop: Crop
    intrinsics: Tensor
    intrinsics_from: str
    notes: tuple[str, ...]

    @staticmethod
    def of(
        image: str | Path | Photo | NDArray[Any],
        category: str,
        size: int,
        mask: NDArray[Any] | None = None,
        box: tuple[float, float, float, float] | None = None,
        intrinsics: NDArray[Any] | Tensor | None = None,
        depth: NDArray[Any] | None = None,
        segmenter: str | Path | Segmenter | None = None,
    ) -> Sighting:
        """Find the object and cut it out, as `kfit.models.CategoryModel.pose` says.

        Args:
            image, mask, box, intrinsics, depth, segmenter: as there.
            category: that a segmenter is to look for.
            size: of the picture in pixels.

        Raises:
            FileNotFoundError, ValueError: for what cannot be used, in one sentence.
        """
        notes: list[str] = []
        alpha, known = None, None
        if isinstance(image, str | Path | Photo):
            photo = image if isinstance(image, Photo) else read_photo(image)
            pixels, known = photo.image, photo.intrinsics
            alpha = None if photo.alpha is None else mask_from_alpha(photo.alpha)
        else:
            pixels = as_photo(image)
        if isinstance(segmenter, str | Path):
            segmenter = load_segmenter(segmenter)
        found = choose_mask(pixels, mask, box, alpha, segmenter, category, notes)
        camera, came_from = choose_camera(pixels, intrinsics, known, notes)
        crop = Crop.around(found, size)
        if depth is None:
            observation = crop.cut(pixels, found)
        else:
            observation = observed(crop, pixels, found, choose_depth(depth, found), camera.double())
        return Sighting(observation, found, crop, camera, came_from, tuple(notes))
