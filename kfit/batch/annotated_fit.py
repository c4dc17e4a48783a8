"""Wild6D, HouseCat6D, Objectron and data sets in BOP's format as data sets to fit."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from kfit.batch.fit_data import FitData, ImageToFit, ObjectToFit
from kfit.batch.nocs_fit import object_key, prediction_of
from kfit.core.arguments import check_arguments
from kfit.data.annotated_frame import AnnotatedFrame, AnnotatedObject
from kfit.data.annotated_frames import AnnotatedFrames
from kfit.pose.result import PoseResult
from kfit.segmentation import ObjectMask, depth_from_file, read_photo


class AnnotatedFit(FitData):
    """Frames of a data set with known poses; each gets a file that `kfit evaluate` reads.

    Objects are selected by the data set's masks; without masks, by the boxes of their true poses, in which
    `kfit.segmentation.ObjectMask` segments them. Objects of categories that the results' format does not support are
    skipped: NOCS's has six, BOP's those that ``source`` names.

    Args:
        source: reads the data set: `kfit.data.wild6d.Wild6DFrames`, `kfit.data.housecat6d.HouseCat6DFrames`,
            `kfit.data.objectron.ObjectronFrames` or `kfit.data.bop.BOPFrames`.
        batch_size: frames that are fitted at once in a process.
    """

    def __init__(self, source: AnnotatedFrames, batch_size: int = 1) -> None:
        super().__init__()
        check_arguments(type(self), locals())
        self.source, self.batch_size = source, batch_size
        self.categories = source.categories

    @property
    def settings(self) -> dict[str, Any]:
        names = "\n".join(self._index)
        return {
            "source": f"{type(self.source).__module__}.{type(self.source).__qualname__}",
            "frames": hashlib.sha256(names.encode()).hexdigest()[:16],
        }

    @cached_property
    def _index(self) -> dict[str, int]:
        return {self.source.result_name(index): index for index in range(len(self.source))}

    def names(self) -> list[str]:
        return list(self._index)

    def read(self, name: str) -> ImageToFit:
        frame = self.source[self._index[name]]
        things = tuple(thing for thing in frame.objects if thing.category in self.categories)
        frame = AnnotatedFrame(frame.path, frame.image, frame.intrinsics, things, frame.depth, frame.depth_unit)
        photo = read_photo(frame.image)
        depth = None
        if frame.depth is not None:
            # 16-bit pictures are read as millimetres.
            depth = depth_from_file(frame.depth, photo.image.shape[:2]) * np.float32(1000 * frame.depth_unit)
        objects = [
            ObjectToFit(thing.category, self._mask(thing, photo.image), object_key(name, thing.instance))
            for thing in things
        ]
        return ImageToFit(name, photo, objects, frame.intrinsics, depth, frame)

    def write(self, path: Path, image: ImageToFit, answers: Sequence[PoseResult | str]) -> None:
        found = [
            prediction_of(thing, answer)
            for thing, answer in zip(image.objects, answers, strict=True)
            if isinstance(answer, PoseResult)
        ]
        self.source.write(path, image.source, found)

    @staticmethod
    def _mask(thing: AnnotatedObject, image: Any) -> Any:
        if thing.mask is not None:
            return thing.mask
        top, left, bottom, right = (int(side) for side in thing.box)
        return ObjectMask()(image, thing.category, (left, top, right - left, bottom - top)).mask
