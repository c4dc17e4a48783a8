"""A folder of photos with masks as a data set to fit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from kfit.batch.fit_data import FitData, ImageToFit, ObjectToFit
from kfit.core.arguments import check_arguments
from kfit.pose.result import PoseResult
from kfit.segmentation import depth_from_file, mask_from_alpha, mask_from_file, read_photo

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
ASIDE = ("_mask", "_depth")


class PhotoFolder(FitData):
    """Photos of one object each; ``cup.jpg`` gets a ``cup.json`` with the answer of ``kfit pose`` with the same seed.

    The object is selected by ``cup_mask.png``, else by the photo's alpha channel. Depth, where it is to be used, is in
    ``cup_depth.png`` (16-bit millimetres) or ``cup_depth.npy`` (metres). A photo that cannot be used or fitted gets no
    file, so another run tries it again.

    Args:
        root: folder of the photos.
        category: category of the objects.
        batch_size: photos that are fitted at once in a process. More suit a GPU and gain
            nothing on a CPU; they change the rounding, which a fit may carry to a degree.
    """

    def __init__(self, root: Path, category: str, batch_size: int = 1) -> None:
        super().__init__()
        check_arguments(PhotoFolder, locals())
        self.root, self.category, self.batch_size = Path(root), category, batch_size
        self.categories = (category,)

    @property
    def settings(self) -> dict[str, Any]:
        return {"category": self.category}

    def names(self) -> list[str]:
        return [f"{stem}.json" for stem in self._photos]

    def read(self, name: str) -> ImageToFit:
        stem = name.removesuffix(".json")
        photo = read_photo(self._photos[stem])
        shape = photo.image.shape[:2]
        file = self.root / f"{stem}_mask.png"
        mask = mask_from_file(file, shape) if file.exists() else None
        if mask is None and mask_from_alpha(photo.alpha) is None:
            raise ValueError(f"no mask of the object: neither {file} nor an alpha channel of the photo")
        depths = [path for path in (self.root / f"{stem}_depth{end}" for end in (".png", ".npy")) if path.exists()]
        depth = depth_from_file(depths[0], shape) if depths else None
        return ImageToFit(name, photo, [ObjectToFit(self.category, mask)], depth=depth)

    def write(self, path: Path, image: ImageToFit, answers: Sequence[PoseResult | str]) -> None:
        (answer,) = answers
        if isinstance(answer, PoseResult):
            path.write_text(json.dumps(answer.to_dict(), indent=2) + "\n")

    @cached_property
    def _photos(self) -> dict[str, Path]:
        if not self.root.is_dir():
            raise FileNotFoundError(f"there is no folder {self.root}")
        photos: dict[str, Path] = {}
        for path in sorted(self.root.iterdir()):
            if path.suffix.lower() in SUFFIXES and not path.stem.endswith(ASIDE):
                if path.stem in photos:
                    raise ValueError(f"{photos[path.stem]} and {path} would both have their result in {path.stem}.json")
                photos[path.stem] = path
        if not photos:
            raise FileNotFoundError(f"{self.root} holds no photos: no {', '.join(SUFFIXES)}")
        return photos
