"""The contract of a reader of a data set whose objects have known poses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

from kfit.data.annotated_frame import AnnotatedFrame
from kfit.data.nocs_pickle import dump_pickle
from kfit.data.nocs_results import NOCSPrediction, make_result
from kfit.geometry import CATEGORIES


class AnnotatedFrames(ABC):
    """Reads a data set, a frame when it is asked for."""

    @property
    def categories(self) -> tuple[str, ...]:
        """Names of the categories that results can hold: NOCS's six unless a data set has a format of its own."""
        return tuple(CATEGORIES)

    @abstractmethod
    def __len__(self) -> int:
        """Number of frames."""

    @abstractmethod
    def __getitem__(self, index: int) -> AnnotatedFrame:
        """Read a frame.

        Raises:
            FileNotFoundError, ValueError: for files that are missing or hold something else.
        """

    @abstractmethod
    def result_name(self, index: int) -> str:
        """Name of the file of a frame's result."""

    def write(self, path: Path, frame: AnnotatedFrame, found: Sequence[NOCSPrediction]) -> None:
        """Write what was found in a frame, by default as `kfit evaluate` reads it."""
        dump_pickle(path, make_result(frame, found))
