"""What one visitor of the page has handed in so far, kept apart from the others' and deleted with the visit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.app.downloads import snippet_of, write_downloads
from kfit.app.examples import Example
from kfit.app.uploads import check_size, checked, read_upload
from kfit.app.watched import Drawn, watched
from kfit.models import load
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.pose.targets import find_targets, with_score
from kfit.segmentation import ObjectMask, Photo, depth_from_file, mask_from_alpha, mask_from_file

# A brush's width, in longer sides of the picture, and the points of a stroke beyond which the rest is dropped.
BRUSH, MOST_POINTS = 0.03, 4000
Fractions = tuple[float, float, float, float]
Camera = tuple[float, float, float, float]


class Session:
    """One visitor's picture, the mask on it, and a folder of what may be downloaded.

    Args:
        folder: of its own, deleted by `close`.

    Attributes:
        category: that is likely, or was chosen last.
        depth: (H, W) in metres, where it was handed in.
        targets: what was found in the photo.
        busy: whether a fit of it waits or runs, so that it makes room for no other.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.photo: Photo | None = None
        self.mask: NDArray[np.float32] | None = None
        self.depth: NDArray[np.float32] | None = None
        self.category: str | None = None
        self.targets: list[FoundObject] = []
        self.busy = False
        self._name = self._depth_name = ""
        # Arguments of `kfit pose` that give the object.
        self._told: list[str] = []

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
        return self._seen().image

    def take(self, path: Path) -> None:
        """Read an uploaded photo and delete the file; an alpha channel that sets an object off is its mask.

        Without such a channel the objects of kfit's categories are found, and the first of them is chosen.

        Raises:
            ValueError: for a file that cannot be used, in one sentence; what was there before stays.
        """
        try:
            photo = read_upload(path)
        finally:
            path.unlink(missing_ok=True)
        alpha = mask_from_alpha(photo.alpha)
        self._begin(photo, path.name, alpha)
        self.targets = find_targets(photo) if alpha is None else []
        if self.targets:
            self.choose(0)

    def found(self) -> list[str]:
        """Names of what was found, each with its probability."""
        return [f"{target.category} ({100 * target.score:.0f} %)" for target in self.targets]

    def choose(self, number: int) -> None:
        """Take what was found as number ``number``, from 0, for the object."""
        target = self.targets[number]
        self.mask, self.category = target.segment.mask, target.category
        self._told = ["--box", *(f"{part:.0f}" for part in target.box)]

    def take_example(self, example: Example) -> None:
        """Take an example's picture and mask."""
        image = example.image()
        self._begin(Photo(image.astype(np.float32) / np.float32(255)), f"{example.name}.png", None)
        self.mask, self.category = mask_from_file(example.mask, image.shape[:2]), example.category
        self._told = ["--mask", "mask.png"]

    def take_mask(self, path: Path) -> None:
        """Read an uploaded mask and delete the file.

        Raises:
            ValueError: if it cannot be used or there is no photo yet; what was there before stays.
        """
        try:
            self.mask = checked(path, lambda file: mask_from_file(file, self._seen().image.shape[:2]))
        finally:
            path.unlink(missing_ok=True)
        self._told = ["--mask", path.name]

    def take_depth(self, path: Path) -> None:
        """Read an uploaded depth map and delete the file.

        Raises:
            ValueError: if it cannot be used or there is no photo yet; what was there before stays.
        """
        try:
            check_size(path)
            read = partial(depth_from_file, shape=self._seen().image.shape[:2])
            # What lies in memory by a file's map would be gone with the file.
            self.depth = np.array(read(path) if path.suffix == ".npy" else checked(path, read))
        except (ValueError, OSError) as error:
            raise ValueError(str(error).replace(str(path), path.name)) from error
        finally:
            path.unlink(missing_ok=True)
        self._depth_name = path.name

    def draw(self, box: Fractions) -> None:
        """Find the object in a box; where none is found there is no mask.

        Args:
            box: left, top, width and height as fractions of the picture's width and height.

        Raises:
            ValueError: if nothing stands out in the box, or there is no photo yet.
        """
        image = self._seen().image
        height, width = image.shape[:2]
        left, top, across, down = (
            round(part * whole) for part, whole in zip(box, (width, height, width, height), strict=True)
        )
        self.mask = None
        self.mask = ObjectMask()(image, "object", (left, top, across, down)).mask
        self._told = ["--box", *(str(number) for number in (left, top, across, down))]

    def paint(self, points: Sequence[tuple[float, float]], keep: bool) -> None:
        """Add what a brush went over to the mask, or take it away.

        Args:
            points: (x, y) of the stroke as fractions of the picture's width and height.
            keep: whether it belongs to the object.

        Raises:
            ValueError: if there is no mask to change, or nothing would be left of it.
        """
        image = self._seen().image
        if self.mask is None:
            raise ValueError("Draw a box around the object first; then its mask can be corrected.")
        height, width = image.shape[:2]
        line = np.array([[x * width, y * height] for x, y in points[:MOST_POINTS]]).clip(0, max(height, width))
        mask = np.ascontiguousarray(self.mask > 0.5, np.uint8)
        broad = max(1, round(BRUSH * max(height, width)))
        cv2.polylines(mask, [line.round().astype(np.int32)], False, int(keep), broad)
        if not mask.any():
            raise ValueError("Nothing would be left of the object; the mask stays as it was.")
        self.mask, self._told = mask.astype(np.float32), ["--mask", "mask.png"]

    def fit(self, category: str | None, camera: Camera | None = None) -> Iterator[Drawn | PoseResult]:
        """Fit what the mask shows: one `Drawn` a step, at last the result.

        Args:
            category: of the object.
            camera: fx, fy, cx and cy in pixels.

        Raises:
            ValueError: if picture, mask or category is still to be given.
        """
        photo = self._seen()
        if self.mask is None:
            raise ValueError("Draw a box around the object first, so that it is known what is to be fitted.")
        if category is None:
            raise ValueError("Choose what kind of object it is.")
        # The photo's own alpha channel is used as `kfit pose` does, which is not told of it.
        mask = self.mask if self._told else None
        intrinsics = None
        if camera is not None:
            fx, fy, cx, cy = camera
            intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return self._checked(watched(_model(category), photo, mask, intrinsics, self.depth), photo, category, mask)

    @staticmethod
    def _checked(
        news: Iterator[Drawn | PoseResult], photo: Photo, category: str, mask: NDArray[np.float32] | None
    ) -> Iterator[Drawn | PoseResult]:
        """The same, with the answer's confidence bounded by how probable the category is."""
        for one in news:
            if isinstance(one, PoseResult):
                (target,) = find_targets(photo, category, mask)
                yield with_score(one, target)
            else:
                yield one

    def command(self, category: str, camera: Camera | None = None) -> str:
        """The line that does the same in a terminal."""
        from shlex import join

        words = ["kfit", "pose", self._name, "--category", category, *self._told]
        words += ["--intrinsics", *(f"{part:g}" for part in camera)] if camera is not None else []
        return join(words + (["--depth", self._depth_name] if self.depth is not None else []))

    def write(self, result: PoseResult, camera: Camera | None = None) -> dict[str, Path]:
        """Write what can be downloaded, `kfit.app.downloads.FILES`; paths by name.

        Raises:
            ValueError: if the visit is over; the folder would be there for good.
        """
        self._seen()
        depth = self._depth_name if self.depth is not None else None
        snippet = snippet_of(self._name, result.category, camera, depth)
        return write_downloads(self.folder, result, self.command(result.category, camera), snippet)

    def clear(self) -> None:
        """Forget the photo and what belongs to it; what was downloaded may be so again."""
        self.photo = self.mask = self.depth = self.category = None
        self.targets = []

    def close(self) -> None:
        """Delete everything."""
        self.clear()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _begin(self, photo: Photo, name: str, mask: NDArray[np.float32] | None) -> None:
        self.clear()
        self.photo, self.mask, self._name, self._told = photo, mask, name, []

    def _seen(self) -> Photo:
        if self.photo is None:
            raise ValueError("There is no picture: choose one, also if you had, as pictures are not kept for long.")
        return self.photo


@lru_cache
def _model(category: str) -> CategoryModel:
    return load(category)
