"""CAMERA25 and REAL275 on disk, in the published folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, overload

import numpy as np

from kfit.core.arguments import check_arguments
from kfit.data.nocs_frame import CAMERA_INTRINSICS, REAL_INTRINSICS, NOCSFrame, read_frame

Split = Literal["camera_train", "camera_val", "real_train", "real_test"]
# Where each part of the data may lie below the root: as NOCS's code wants it, as object-deformnet's does, as unpacked.
_PLACES: dict[str, tuple[str, ...]] = {
    "camera_train": ("camera/train", "CAMERA/train", "train"),
    "camera_val": ("camera/val", "CAMERA/val", "val"),
    "real_train": ("real/train", "Real/train", "real_train"),
    "real_test": ("real/test", "Real/test", "real_test"),
}
_FILES = ("color.png", "depth.png", "coord.png", "mask.png", "meta.txt")


class NOCSFrames(Sequence[NOCSFrame]):
    """The frames of one split of the data, read on access.

    Below ``root`` lie the frames (``camera/val/00000/0000_color.png``, ``real/test/scene_1/0000_color.png``, or the
    part's folder alone) and, where they are at hand, ``camera_full_depths``, ``gts`` and ``obj_models``. Frames that
    lack a file, some thousands of CAMERA's, are left out.

    Args:
        root: folder that holds it all.
        split: ``"camera_train"``, ``"camera_val"``, ``"real_train"`` or ``"real_test"``.

    Attributes:
        paths: the frames' common beginnings, sorted.

    Raises:
        FileNotFoundError: if the root has no folder of the split.
        ValueError: if the split is unknown, or its folder has no complete frame.

    Example:
        >>> from kfit.data import NOCSFrames
        >>> NOCSFrames("NOCS", "real_test")
        Traceback (most recent call last):
        FileNotFoundError: ...
    """

    def __init__(self, root: str | Path, split: Split) -> None:
        check_arguments(NOCSFrames, locals())
        root = Path(root)
        folder = next((root / place for place in _PLACES[split] if (root / place).is_dir()), None)
        if folder is None:
            raise FileNotFoundError(f"root must hold {' or '.join(_PLACES[split])}, but {root} does not")
        self.root, self.split = root, split
        self.paths = [path for scene in sorted(folder.iterdir()) if scene.is_dir() for path in _frames(scene)]
        if not self.paths:
            raise ValueError(f"{folder} holds no frame with all of {', '.join('_' + name for name in _FILES)}")

    def __len__(self) -> int:
        return len(self.paths)

    @overload
    def __getitem__(self, index: int) -> NOCSFrame: ...
    @overload
    def __getitem__(self, index: slice) -> list[NOCSFrame]: ...
    def __getitem__(self, index: int | slice) -> NOCSFrame | list[NOCSFrame]:
        """Read a frame, or several."""
        if isinstance(index, slice):
            return [self._read(path) for path in self.paths[index]]
        return self._read(self.paths[index])

    def _read(self, path: Path) -> NOCSFrame:
        synthetic = self.split.startswith("camera")
        part = self.split.removeprefix("camera_")
        scene, number = path.parts[-2:]
        return read_frame(
            path,
            np.array(CAMERA_INTRINSICS if synthetic else REAL_INTRINSICS),
            _existing(self.root / "camera_full_depths" / part / scene / f"{number}_composed.png"),
            _existing(self.root / "gts" / part / f"results_{part}_{scene}_{number}.pkl"),
            _existing(self.root / "obj_models" / part),
        )


def _frames(scene: Path) -> list[Path]:
    names = {path.name for path in scene.iterdir()}
    numbers = sorted(name.removesuffix("_color.png") for name in names if name.endswith("_color.png"))
    return [scene / number for number in numbers if all(f"{number}_{name}" in names for name in _FILES)]


def _existing(path: Path) -> Path | None:
    return path if path.exists() else None
