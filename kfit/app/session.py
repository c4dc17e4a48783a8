"""What one visitor of the page has handed in so far, kept apart from the others' and deleted with the visit."""

from __future__ import annotations

import json
import shutil
from collections import OrderedDict
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.app.uploads import checked, read_upload
from kfit.app.watched import Drawn, watched
from kfit.models import load
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.pose.targets import find_targets
from kfit.runtime.atomic_write import atomic_write
from kfit.segmentation import Photo, mask_from_alpha, mask_from_file

EXAMPLE_MASK = Path(__file__).parent / "coffee_mask.png"
# Idle visitors are forgotten beyond so many sessions, and pixels in all of them, which are 12 bytes each.
MOST_SESSIONS, MOST_PIXELS = 24, 200_000_000
Fractions = tuple[float, float, float, float]


class Session:
    """One visitor's picture, the mask on it, and a folder of what may be downloaded.

    Args:
        folder: of its own, deleted by `close`.

    Attributes:
        photo: the picture.
        targets: what was found in it.
        target: the one that is to be fitted, found, drawn or told by a mask.
        busy: whether a fit of it waits or runs, so that it makes room for no other.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.photo: Photo | None = None
        self.targets: list[FoundObject] = []
        self.target: FoundObject | None = None
        self.busy = False
        self._name = ""
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

    def take(self, path: Path) -> None:
        """Read an uploaded photo, delete the file, and find the objects of kfit's categories.

        An alpha channel that sets an object off tells the one that is meant. The first found is chosen.

        Raises:
            ValueError: for a file that cannot be used, in one sentence; what was there before stays.
        """
        try:
            photo = read_upload(path)
        finally:
            path.unlink(missing_ok=True)
        targets = find_targets(photo)
        self.photo, self._name, self._pointed, self._words = photo, path.name, {}, []
        self.target = targets[0] if targets else None
        self.targets = targets if mask_from_alpha(photo.alpha) is None else []

    def found(self) -> list[str]:
        """Names of what was found, each with its probability."""
        return [f"{target.category} ({100 * target.score:.0f} %)" for target in self.targets]

    def choose(self, number: int) -> None:
        """Take what was found as number ``number``, from 0, for the object."""
        self.target, self._pointed, self._words = self.targets[number], {}, []

    def take_example(self) -> None:
        """Take the photo of a cup that scikit-image ships, with a mask drawn by hand."""
        from skimage.data import coffee

        self.photo, self.targets, self._name = Photo(coffee().astype(np.float32) / np.float32(255)), [], "coffee.png"
        self._point(["--mask", EXAMPLE_MASK.name], mask=mask_from_file(EXAMPLE_MASK, self.photo.image.shape[:2]))

    def take_mask(self, path: Path) -> None:
        """Read an uploaded mask and delete the file.

        Raises:
            ValueError: if it cannot be used or there is no photo yet; what was there before stays.
        """
        try:
            mask = checked(path, lambda file: mask_from_file(file, self._seen().image.shape[:2]))
        finally:
            path.unlink(missing_ok=True)
        self._point(["--mask", path.name], mask=mask)

    def draw(self, box: Fractions) -> None:
        """Find the object in a box; where none is found there is no mask.

        Args:
            box: left, top, width and height as fractions of the picture's width and height.

        Raises:
            ValueError: if nothing stands out in the box, or there is no photo yet.
        """
        height, width = self._seen().image.shape[:2]
        left, top, across, down = (
            round(part * whole) for part, whole in zip(box, (width, height, width, height), strict=True)
        )
        self.target = None
        box_in_pixels = (left, top, across, down)
        self._point(["--box", *map(str, box_in_pixels)], box=box_in_pixels)

    def _point(self, words: list[str], **pointed: Any) -> None:
        """Take what a mask or a box points at for the object; ``words`` tell `kfit pose` the same."""
        (self.target,) = find_targets(self._seen(), **pointed)
        self._pointed, self._words = pointed, words

    def fit(self, category: str | None) -> Iterator[Drawn | PoseResult]:
        """Fit the object as `command` does: one `Drawn` a step, at last the result.

        Raises:
            ValueError: if picture, object or category is still to be given.
        """
        photo, target = self._seen(), self.target
        if target is None:
            raise ValueError("Draw a box around the object first, so that it is known what is to be fitted.")
        if category is None:
            raise ValueError("Choose what kind of object it is.")
        pointed, words = self._arguments(category)
        if words:
            (target,) = find_targets(photo, category, **pointed)
        return watched(_model(category), photo, target)

    def command(self, category: str) -> str:
        """The line that does the same in a terminal, for one object or, where it is named by nothing, for all."""
        from shlex import join

        return join(["kfit", "pose", self._name, *self._arguments(category)[1]])

    def _arguments(self, category: str) -> tuple[dict[str, Any], list[str]]:
        """What tells the object to `find_targets`, and what to `kfit pose`; nothing where it is as it was found."""
        named, target = ["--category", category], self.target
        if self._pointed or target is None:
            return self._pointed, [*named, *self._words]
        if category == target.category:
            return {}, []
        if not self.targets:  # the alpha channel tells it
            return {}, named
        return {"box": target.box}, [*named, "--box", *(f"{part:.0f}" for part in target.box)]

    def write(self, result: PoseResult) -> tuple[Path, Path]:
        """Write what can be downloaded: report.html and pose.json, both or neither.

        Raises:
            ValueError: if the visit is over; the folder would be there for good.
        """
        self._seen()
        from kfit import report

        page, numbers = atomic_write(
            self.folder,
            {
                "report.html": lambda path: report(result, path, command=self.command(result.category)),
                "pose.json": lambda path: path.write_text(json.dumps(result.to_dict(), indent=2) + "\n"),
            },
        )
        return page, numbers

    def close(self) -> None:
        """Delete everything."""
        self.photo = self.target = None
        self.targets = []
        shutil.rmtree(self.folder, ignore_errors=True)

    def _seen(self) -> Photo:
        if self.photo is None:
            raise ValueError("There is no picture: choose one, also if you had, as pictures are not kept for long.")
        return self.photo


class Sessions:
    """All visitors' sessions; of those that are not busy, the one used longest ago makes room where they are too many.

    Args:
        folder: in which each gets a folder of its own.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._open: OrderedDict[str, Session] = OrderedDict()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._open)

    def of(self, visitor: str) -> Session:
        """The visitor's session, a new one at the first call."""
        with self._lock:
            if visitor not in self._open:
                self._open[visitor] = Session(Path(mkdtemp(prefix="session-", dir=self.folder)))
            self._open.move_to_end(visitor)
            idle = [name for name, session in self._open.items() if not session.busy and name != visitor]
            for name in idle:
                pixels = sum(session.pixels for session in self._open.values())
                if len(self._open) <= MOST_SESSIONS and pixels <= MOST_PIXELS:
                    break
                self._open.pop(name).close()
            return self._open[visitor]

    def close(self, visitor: str) -> None:
        """Forget the visitor and delete what is theirs; fine where nothing is."""
        with self._lock:
            session = self._open.pop(visitor, None)
        if session is not None:
            session.close()


@lru_cache
def _model(category: str) -> CategoryModel:
    return load(category)
