"""A folder of results that a run adds to until it is complete, and another goes on with."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from kfit import __version__
from kfit.runtime.atomic_write import PARTIAL, atomic_write

SETTINGS = "fit.json"


@dataclass(frozen=True)
class ResultsFolder:
    """A folder of atomically written results, all with the settings in its ``fit.json``.

    Attributes:
        path: path of the folder, which need not exist yet.
    """

    path: Path

    def left(self, names: Sequence[str], settings: Mapping[str, object]) -> list[str]:
        """Those of the names that have no file yet. What a killed run left unfinished is removed.

        Args:
            names: names of all files that will be written.
            settings: plain values that decide the results; kfit's version is added.

        Raises:
            ValueError: if there are results of other settings, or of unknown ones.
        """
        there = {path.name for path in self.path.iterdir()} if self.path.is_dir() else set()
        left = [name for name in names if name not in there]
        settings = {"kfit": __version__, **settings}
        if SETTINGS in there:
            self._compare(settings)
        elif len(left) < len(names):
            raise ValueError(f"{self.path} holds results, but no {SETTINGS} with their settings: name another folder")
        else:
            self.write(SETTINGS, lambda path: path.write_text(json.dumps(settings, indent=2) + "\n"))
        for name in there:
            if name.startswith(PARTIAL):
                shutil.rmtree(self.path / name, ignore_errors=True)
        return left

    def has(self, name: str) -> bool:
        """Whether there is a file of that name."""
        return (self.path / name).exists()

    def write(self, name: str, write: Callable[[Path], object]) -> bool:
        """Write a file atomically and flush it to disk; return False if none was written."""
        return bool(atomic_write(self.path, {name: write}))

    def _compare(self, settings: Mapping[str, object]) -> None:
        kept = self.path / SETTINGS
        try:
            known = dict(json.loads(kept.read_text()))
        except (ValueError, TypeError):
            raise ValueError(f"{kept} is damaged, so the settings of its results are unknown") from None
        other = [
            f"{name} {known.get(name, 'untold')} there and {settings.get(name, 'untold')} now"
            for name in {**settings, **known}
            if known.get(name) != settings.get(name)
        ]
        if other:
            differences = "; ".join(other)
            raise ValueError(
                f"{self.path} holds results of other settings, {differences}: keep to those or name another folder"
            )
