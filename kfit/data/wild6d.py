"""Wild6D's test set: videos of single objects with depth, masks and poses (Fu and Wang, NeurIPS 2022)."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from kfit.core.arguments import check_arguments
from kfit.data.annotated_frame import WORDS, AnnotatedFrame, AnnotatedObject
from kfit.data.annotated_frames import AnnotatedFrames
from kfit.data.nocs_frame import read_picture
from kfit.data.nocs_pickle import load_pickle


class Wild6DFrames(AnnotatedFrames):
    """Frames of ``test_set/CATEGORY/OBJECT/VIDEO/images/N.jpg`` whose pose ``pkl_annotations`` gives.

    Next to each picture lie ``N-mask.png`` and ``N-depth.png``; the video's ``metadata`` holds K, column after column.

    Args:
        root: the folder ``test_set``.
        category: one of its categories, ``bottle``, ``bowl``, ``camera``, ``laptop`` or ``mug``.
    """

    def __init__(self, root: str, category: str) -> None:
        check_arguments(Wild6DFrames, locals())
        self.root, self.category = Path(root), category
        folder = self.root / "pkl_annotations" / category
        self.files = sorted(folder.glob("*.pkl"))
        if not self.files:
            raise FileNotFoundError(f"{folder} holds no annotations: no *.pkl")
        self.index = [(file, number) for file in self.files for number in self._numbers(file)]
        if not self.index:
            place = self._images(self.files[0])
            raise FileNotFoundError(f"{place} holds no annotated frames: no N.jpg with N-mask.png")

    def __len__(self) -> int:
        return len(self.index)

    def result_name(self, index: int) -> str:
        file, number = self.index[index]
        return f"results_{file.stem.replace('-', '_')}_{number:04}.pkl"

    def __getitem__(self, index: int) -> AnnotatedFrame:
        file, number = self.index[index]
        annotation, images = _annotations(file)[number], self._images(file)
        try:
            stored, translation, size = (
                np.asarray(annotation[name], float) for name in ("rotation", "translation", "size")
            )
            # Some hold a scale, or a mirror image.
            with np.errstate(all="ignore"):  # AnnotatedObject.of refuses what is not finite
                rotation = stored / np.cbrt(np.linalg.det(stored))
            intrinsics = _intrinsics(images.parent / "metadata")
            mask = read_picture(images / f"{number}-mask.png", 0) > 0
            name = WORDS.get(self.category, self.category)
            placed = (rotation, translation.ravel(), size.ravel())
            thing = AnnotatedObject.of(0, name, *placed, intrinsics, mask)
        except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
            raise ValueError(f"{file} has no pose of frame {number}: {error}") from None
        depth = images / f"{number}-depth.png"
        where = Path(*file.stem.split("-"), str(number))
        return AnnotatedFrame(where, images / f"{number}.jpg", intrinsics, (thing,), depth if depth.is_file() else None)

    def _images(self, file: Path) -> Path:
        _, thing, video = file.stem.rsplit("-", 2)
        return self.root / self.category / thing / video / "images"

    def _numbers(self, file: Path) -> list[int]:
        images = self._images(file)
        return [
            number
            for number in range(len(_annotations(file)))
            if (images / f"{number}.jpg").is_file() and (images / f"{number}-mask.png").is_file()
        ]


@lru_cache(maxsize=4)
def _annotations(file: Path) -> list[dict[str, Any]]:
    content = load_pickle(file)
    if not isinstance(content, dict) or not isinstance(content.get("annotations"), list):
        raise ValueError(f"{file} holds no annotations of Wild6D: a dict with a list of annotations was expected")
    frames: list[dict[str, Any]] = content["annotations"]
    return frames


@lru_cache(maxsize=4)
def _intrinsics(file: Path) -> np.ndarray:
    try:
        values = np.asarray(json.loads(file.read_text(encoding="utf-8"))["K"], float)
        return values.reshape(3, 3).T
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{file} holds no intrinsics K: {error}") from None
