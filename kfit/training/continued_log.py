"""Logging of resumed runs: rows logged before the checkpoint are kept."""

from __future__ import annotations

import csv
import re
import warnings
from pathlib import Path
from typing import Any

from lightning.fabric.loggers.logger import rank_zero_experiment
from lightning.pytorch.loggers import CSVLogger

_RUN = re.compile(r"version_\d+")


def run_of(checkpoint: object) -> Path | None:
    """Return the folder of the run that wrote a checkpoint, ``…/version_N``; None if there is no such folder."""
    if not isinstance(checkpoint, str | Path) or "://" in str(checkpoint):
        return None
    path = Path(checkpoint)
    folder = path.absolute().parent.parent
    return folder if path.is_file() and path.parent.name == "checkpoints" and _RUN.fullmatch(folder.name) else None


class ContinuedCSVLogger(CSVLogger):
    """Continues a run's ``metrics.csv`` after the rows up to the step of its checkpoint.

    Args:
        run: folder of the run.
        step: step at which the checkpoint was written; rows of later steps are replaced.
    """

    def __init__(self, run: Path, step: int) -> None:
        super().__init__(run.parent.parent, run.parent.name, run.name)
        self.step = step

    @property
    @rank_zero_experiment
    def experiment(self) -> Any:
        """Return Lightning's writer, with the kept rows."""
        if self._experiment is None:
            table = Path(self.log_dir) / "metrics.csv"
            rows = self._rows(table)
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Experiment logs directory .* exists")
                writer: Any = CSVLogger.experiment.fget(self)  # type: ignore[attr-defined]
            if rows:
                writer.metrics_keys = sorted(rows[0])
                with table.open("w", newline="", encoding="utf-8") as file:
                    out = csv.DictWriter(file, fieldnames=writer.metrics_keys)
                    out.writeheader()
                    out.writerows(rows)
        return self._experiment

    def _rows(self, table: Path) -> list[dict[str, str]]:
        if not table.is_file():
            return []
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        return [row for row in rows if row.get("step", "").isdecimal() and int(row["step"]) < self.step]
