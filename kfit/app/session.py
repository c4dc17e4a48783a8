"""The uploads of one visitor of the page, kept apart from others and deleted with the visit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.app.brush import with_stroke
from kfit.app.downloads import snippet_of, write_downloads
from kfit.app.examples import Example
from kfit.app.uploads import check_size, checked, read_upload, received
from kfit.app.watched import Drawn, watched
from kfit.geometry import CATEGORIES
from kfit.models import load
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.object_finder import FoundObject, box_of
from kfit.pose.targets import find_targets
from kfit.segmentation import Photo, Segment, depth_from_file, mask_from_alpha, mask_from_file

Fractions = tuple[float, float, float, float]
Camera = tuple[float, float, float, float]


class Session:
    """One visitor's picture, the mask on it, and a folder of what may be downloaded.

    Args:
        folder: Folder that only this session uses; `close` deletes it.
        models: Paths of models by the category that they serve, instead of a bundled one.

    Attributes:
        photo: the picture.
        targets: objects that were found in it.
        target: the object to fit: found, drawn or selected by a mask.
        category: likely category, or the one chosen last.
        depth: (H, W) in metres, where it was passed.
        busy: whether a fit of it waits or runs, so that it makes room for no other.
    """

    def __init__(self, folder: Path, models: Mapping[str, str] | None = None) -> None:
        self.folder, self.models = folder, models or {}
        self.photo: Photo | None = None
        self.target: FoundObject | None = None
        self.depth: NDArray[np.float32] | None = None
        self.category: str | None = None
        self.targets: list[FoundObject] = []
        self.busy = False
        self._name = self._depth_name = ""
        # What points at the object, for `find_targets` and for `kfit pose`; neither where it was found.
        self._pointed: dict[str, Any] = {}
        self._words: list[str] = []

    @property
    def mask(self) -> NDArray[np.float32] | None:
        """Of the object that is to be fitted, (H, W)."""
        return None if self.target is None else self.target.segment.mask

    @property
    def pixels(self) -> int:
        """Number of pixels of the photo."""
        return 0 if self.photo is None else self.photo.image.shape[0] * self.photo.image.shape[1]

    @property
    def image(self) -> NDArray[np.float32]:
        """The photo's pixels (H, W, 3).

        Raises:
            ValueError: if there is no photo.
        """
        return self._photo_or_error().image

    def take(self, path: Path) -> None:
        """Read an uploaded photo, delete the file, and find the objects of kfit's categories.

        An alpha channel around an object selects it. The first found object is selected.

        Raises:
            ValueError: for a file that cannot be used, in one sentence; what was there before stays.
        """
        with received(path):
            photo = read_upload(path)
        targets = find_targets(photo)
        self._begin(photo, path.name)
        self._take_target(targets[0] if targets else None)
        self.targets = targets if mask_from_alpha(photo.alpha) is None else []

    def found(self) -> list[str]:
        """Names of what was found, each with its probability."""
        return [target.words for target in self.targets]

    def choose(self, number: int) -> None:
        """Take what was found as number ``number``, from 0, for the object."""
        self._pointed, self._words = {}, []
        self._take_target(self.targets[number])

    def take_example(self, example: Example) -> None:
        """Take an example's picture and mask."""
        image = example.image()
        self._begin(Photo(image.astype(np.float32) / np.float32(255)), f"{example.name}.png")
        mask = mask_from_file(example.mask, image.shape[:2])
        self._take_target(FoundObject(example.category, 1.0, box_of(mask), Segment(mask)))
        self._pointed, self._words = {"mask": mask}, ["--mask", "mask.png"]

    def take_mask(self, path: Path) -> None:
        """Read an uploaded mask and delete the file.

        Raises:
            ValueError: if it cannot be used or there is no photo yet; the previous state is kept.
        """
        with received(path):
            mask = checked(path, partial(mask_from_file, shape=self.image.shape[:2]))
        self._point(["--mask", path.name], mask=mask)

    def take_depth(self, path: Path) -> None:
        """Read an uploaded depth map and delete the file.

        Raises:
            ValueError: if it cannot be used or there is no photo yet; the previous state is kept.
        """
        with received(path):
            check_size(path)
            read = partial(depth_from_file, shape=self.image.shape[:2])
            # Copied, because the array of a .npy file is mapped from the file.
            self.depth = np.array(read(path) if path.suffix == ".npy" else checked(path, read))
        self._depth_name = path.name

    def draw(self, box: Fractions) -> None:
        """Find the object in a box; without one there is no mask.

        Args:
            box: left, top, width and height as fractions of the picture's width and height.

        Raises:
            ValueError: if the box holds no salient object, or there is no photo yet.
        """
        height, width = self.image.shape[:2]
        left, top, across, down = box
        pixels = (round(left * width), round(top * height), round(across * width), round(down * height))
        self.target = None
        self._point(["--box", *map(str, pixels)], box=pixels)

    def paint(self, points: Sequence[tuple[float, float]], keep: bool) -> None:
        """Add what a brush went over to the mask, or take it away.

        Raises:
            ValueError: if there is no mask to change, or nothing would be left of it.
        """
        self._photo_or_error()
        if self.target is None:
            raise ValueError("Draw a box around the object first; then its mask can be corrected.")
        mask = with_stroke(self.target.segment.mask, points, keep)
        self.target = replace(self.target, segment=Segment(mask))  # `fit` examines it again
        self._pointed, self._words = {"mask": mask}, ["--mask", "mask.png"]

    def fit(self, category: str | None, camera: Camera | None = None) -> Iterator[Drawn | PoseResult]:
        """Fit the object as `command` does: one `Drawn` a step, at last the result.

        Args:
            category: category of the object.
            camera: fx, fy, cx and cy in pixels.

        Raises:
            ValueError: if picture, object or category is still to be given.
        """
        photo, target = self._photo_or_error(), self.target
        if target is None:
            raise ValueError("Draw a box around the object first, so that it is known what is to be fitted.")
        if category is None:
            raise ValueError("Choose what kind of object it is.")
        pointed, words = self._arguments(category)
        if words:
            (target,) = find_targets(photo, category, **pointed)
        intrinsics = None
        if camera is not None:
            fx, fy, cx, cy = camera
            intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return watched(_model(self.models.get(category, category)), photo, target, intrinsics, self.depth)

    def command(self, category: str, camera: Camera | None = None) -> str:
        """The line that does the same in a terminal, for one object or, where it is named by nothing, for all."""
        from shlex import join

        words = ["kfit", "pose", self._name, *self._arguments(category)[1]]
        words += ["--intrinsics", *(f"{part:g}" for part in camera)] if camera is not None else []
        return join(words + (["--depth", self._depth_name] if self.depth is not None else []))

    def _arguments(self, category: str) -> tuple[dict[str, Any], list[str]]:
        """Return the selection for `find_targets`, and for `kfit pose`; empty for an object that was found."""
        named, target = ["--category", category], self.target
        if category in self.models:
            named = ["--model", self.models[category]]
        if self._pointed or target is None:
            return self._pointed, [*named, *self._words]
        if category == target.category and category not in self.models:
            return {}, []
        if not self.targets:  # selected by the alpha channel
            return {}, named
        return {"box": target.box}, [*named, "--box", *(f"{part:.0f}" for part in target.box)]

    def write(self, result: PoseResult, camera: Camera | None = None) -> dict[str, Path]:
        """Write what can be downloaded, `kfit.app.downloads.FILES`; paths by name.

        Raises:
            ValueError: if the visit is over; the folder would be there for good.
        """
        self._photo_or_error()
        depth = self._depth_name if self.depth is not None else None
        snippet = snippet_of(self._name, self.models.get(result.category, result.category), camera, depth)
        return write_downloads(self.folder, result, self.command(result.category, camera), snippet)

    def clear(self) -> None:
        """Forget the photo and what belongs to it; what was downloaded may be so again."""
        self.photo = self.target = self.depth = self.category = None
        self.targets = []

    def close(self) -> None:
        """Delete everything."""
        self.clear()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _begin(self, photo: Photo, name: str) -> None:
        self.clear()
        self.photo, self._name, self._pointed, self._words = photo, name, {}, []

    def _take_target(self, target: FoundObject | None) -> None:
        self.target, self.category = target, None if target is None else target.category

    def _point(self, words: list[str], **pointed: Any) -> None:
        """Select the object of a mask or a box; ``words`` are the same for `kfit pose`."""
        (target,) = find_targets(self._photo_or_error(), **pointed)
        self._pointed, self._words = pointed, words
        own = self.category not in (None, *CATEGORIES)  # chosen, as kfit does not find it
        self.target, self.category = target, self.category if own else target.category

    def _photo_or_error(self) -> Photo:
        if self.photo is None:
            raise ValueError("There is no picture: choose one, also if you had, as pictures are not kept for long.")
        return self.photo


@lru_cache
def _model(model: str) -> CategoryModel:
    return load(model)
