"""Intermediate files of a build of views, of some objects each, written atomically."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kfit.runtime.atomic_write import atomic_write

# Objects of a part: about a second of one core, which is what a build that is killed loses.
SIZE = 16
_SETTINGS = "settings.json"
# Of each object, in this order.
FIELDS = ("images", "depth", "poses", "distances", "extents")


class ViewParts:
    """Parts of a build in their own folder; several processes may add to them, because all draw the same.

    Args:
        folder: created if missing; parts of other settings are removed.
        settings: settings of the build, plain values.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        self.folder, self.settings = folder, dict(settings)
        self.count = -(-int(settings["num_objects"]) // SIZE)
        if folder.is_file():  # of a version that kept one file
            folder.unlink(missing_ok=True)
        elif folder.is_dir() and self._saved() != self.settings:
            shutil.rmtree(folder, ignore_errors=True)
        text = json.dumps(self.settings)
        atomic_write(folder, {_SETTINGS: lambda place: place.write_text(text)})

    def objects(self, part: int) -> range:
        """Numbers of a part's objects."""
        return range(part * SIZE, min((part + 1) * SIZE, int(self.settings["num_objects"])))

    def missing(self) -> list[int]:
        """Numbers of missing parts."""
        there = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        return [part for part in range(self.count) if self._name(part) not in there]

    def write(self, part: int, drawn: list[tuple[np.ndarray, ...]]) -> None:
        """Write a part's objects."""
        arrays: dict[str, Any] = {
            name: np.stack(values) for name, values in zip(FIELDS, zip(*drawn, strict=True), strict=True)
        }
        atomic_write(self.folder, {self._name(part): lambda place: np.savez(place, **arrays)})

    def read(self) -> Iterator[tuple[range, dict[str, np.ndarray]]]:
        """The objects' numbers and arrays, part by part.

        Raises:
            FileNotFoundError: if a part is gone, or was damaged and is gone now.
        """
        for part in range(self.count):
            path = self.folder / self._name(part)
            try:
                with np.load(path, allow_pickle=False) as held:
                    arrays = {name: held[name] for name in FIELDS}
            except (ValueError, KeyError, EOFError, zipfile.BadZipFile):
                path.unlink(missing_ok=True)
                raise FileNotFoundError(f"{path} was damaged") from None
            yield self.objects(part), arrays

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _saved(self) -> Any:
        try:
            return json.loads((self.folder / _SETTINGS).read_text())
        except (OSError, ValueError):
            return None

    @staticmethod
    def _name(part: int) -> str:
        return f"{part:06}.npz"
