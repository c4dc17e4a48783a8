"""CAMERA25 and REAL275 as a data set to fit."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from kfit.batch.fit_data import FitData, ImageToFit, ObjectToFit
from kfit.core.arguments import check_arguments
from kfit.data.nocs_frame import NOCSFrame
from kfit.data.nocs_frames import NOCSFrames, Split
from kfit.data.nocs_pickle import dump_pickle, load_pickle
from kfit.data.nocs_results import NOCSPrediction, make_result
from kfit.geometry import CATEGORIES
from kfit.pose.result import PoseResult
from kfit.segmentation import nocs_detections


class NOCSFit(FitData):
    """Frames of NOCS; each gets a ``results_<split>_<scene>_<number>.pkl`` that `kfit evaluate` reads.

    Every frame gets one, also without any detection. In addition to `kfit.data.make_result` it holds ``unfitted``:
    a sentence for each object that has no prediction. A frame with an object of unknown pose or size could not be
    evaluated, and counts as one that cannot be read.

    Args:
        root: folder that holds the data, see `kfit.data.NOCSFrames`.
        split: ``"camera_train"``, ``"camera_val"``, ``"real_train"`` or ``"real_test"``.
        detections: folder of results of NOCS or in its format (``results_*.pkl``, also object-deformnet's), which tell
            objects, masks and scores; without it they are the true ones, scored by the fits' confidence.
        batch_size: frames that are fitted at once in a process. More suit a GPU and gain
            nothing on a CPU; they change the rounding, which a fit may carry to a degree.
    """

    categories = tuple(CATEGORIES)

    def __init__(self, root: Path, split: Split, detections: Path | None = None, batch_size: int = 1) -> None:
        super().__init__()
        check_arguments(NOCSFit, locals())
        self.root, self.split, self.detections, self.batch_size = Path(root), split, detections, batch_size

    @property
    def settings(self) -> dict[str, Any]:
        masks = "true ones" if self.detections is None else str(Path(self.detections).resolve())
        return {"split": self.split, "masks": masks}

    @cached_property
    def _frames(self) -> NOCSFrames:
        return NOCSFrames(self.root, self.split)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {f"results_{'_'.join(path.parts[-3:])}.pkl": index for index, path in enumerate(self._frames.paths)}

    def names(self) -> list[str]:
        if self.detections is not None and not any(Path(self.detections).glob("results_*.pkl")):
            raise FileNotFoundError(f"detections must be a folder of results_*.pkl, but {self.detections} holds none")
        return list(self._index)

    def read(self, name: str) -> ImageToFit:
        frame = self._frames[self._index[name]]
        make_result(frame, [])
        objects = (
            [ObjectToFit(thing.category, thing.mask, object_key(name, thing.instance)) for thing in frame.objects]
            if self.detections is None
            else self._detected(frame, name)
        )
        return ImageToFit(name, frame.image, objects, frame.intrinsics, frame.depth, frame)

    def write(self, path: Path, image: ImageToFit, answers: Sequence[PoseResult | str]) -> None:
        found = [
            prediction_of(thing, answer)
            for thing, answer in zip(image.objects, answers, strict=True)
            if isinstance(answer, PoseResult)
        ]
        pairs = zip(image.objects, answers, strict=True)
        unfitted = [f"{thing.category}: {answer}" for thing, answer in pairs if isinstance(answer, str)]
        dump_pickle(path, make_result(image.source, found) | {"unfitted": unfitted})

    def _detected(self, frame: NOCSFrame, name: str) -> list[ObjectToFit]:
        scene, number = frame.path.parts[-2:]
        # NOCS names files by the folder, its pickles of true poses by the split, others by the split's last word.
        parts = (frame.path.parts[-3], self.split, self.split.rpartition("_")[2])
        files = [Path(str(self.detections)) / f"results_{part}_{scene}_{number}.pkl" for part in parts]
        file = next((file for file in files if file.is_file()), None)
        if file is None:
            raise FileNotFoundError(f"{self.detections} has no detections for {frame.path}: no {files[0].name}")
        height, width = frame.depth.shape
        try:
            found = nocs_detections(load_pickle(file), (height, width))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{file} holds no detections for {frame.path}: {error}") from None
        named = zip(found.categories, found.names, strict=True)
        return [
            ObjectToFit(category or called, found.mask(index) > 0, object_key(name, index), float(found.scores[index]))
            for index, (category, called) in enumerate(named)
        ]


def object_key(name: str, number: int) -> int:
    """A number for an object, the same wherever and whenever it is fitted."""
    return int.from_bytes(hashlib.sha256(f"{name}/{number}".encode()).digest()[:8], "big")


def prediction_of(thing: ObjectToFit, answer: PoseResult) -> NOCSPrediction:
    """An answer as NOCS's files hold it, scored by its confidence where the object was not detected."""
    left, top, width, height = answer.bbox_xywh
    score = answer.confidence if thing.score is None else thing.score
    box = (top, left, top + height, left + width)
    size = np.asarray(answer.size)
    return NOCSPrediction(answer.category, answer.rotation, answer.translation, size, score, box)
