"""Comparison of trainings by their folders: differences of recipes, results and curves."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]
from matplotlib.figure import Figure

_LARGEST = 500_000_000
# Measures with these parts in their name are better if larger, all others if smaller.
_MORE = ("within_", "ssim", "iou", "under_")


@dataclass(frozen=True)
class TrainingRun:
    """Contents of a training's folder.

    Attributes:
        name: name of the folder, including its parents if several runs share a name.
        recipe: values by dotted name; empty if the folder has no config.yaml.
        metrics: (step, value) pairs by the name of each measure.
    """

    name: str
    recipe: dict[str, Any]
    metrics: dict[str, list[tuple[int, float]]]

    @staticmethod
    def of(folder: str | Path) -> TrainingRun:
        """Read a run's folder, such as ``lightning_logs/version_0``.

        Raises:
            FileNotFoundError: if it has no metrics.csv.
            ValueError: if a file cannot be read.
        """
        path = Path(folder)
        table, recipe = path / "metrics.csv", path / "config.yaml"
        if not table.is_file():
            inside = sorted(one.parent.name for one in path.glob("*/metrics.csv")) if path.is_dir() else []
            hint = f"; its folders {', '.join(inside[:5])} have" if inside else ""
            raise FileNotFoundError(f"{folder} is no folder of a training: it has no metrics.csv{hint}")
        for file in (table, recipe):
            if file.is_file() and file.stat().st_size > _LARGEST:
                raise ValueError(f"{file} has {file.stat().st_size:,} bytes, more than {_LARGEST:,}")
        settings: dict[str, Any] = {}
        if recipe.is_file():
            try:
                settings = _flat(yaml.safe_load(recipe.read_text(encoding="utf-8")))
            except (yaml.YAMLError, UnicodeDecodeError) as error:
                raise ValueError(f"{recipe} is no YAML file: {' '.join(str(error).split())}") from None
        return TrainingRun(str(folder), settings, _metrics(table))

    def last(self, name: str) -> float | None:
        """Return the last value of a measure; None if it was not logged."""
        return self.metrics[name][-1][1] if self.metrics.get(name) else None

    def best(self, name: str) -> float | None:
        """Return a measure's best value: the smallest, or the largest if more is better; None if it was not logged."""
        values = [value for _, value in self.metrics.get(name, []) if math.isfinite(value)]
        if not values:
            return None
        return max(values) if any(part in name for part in _MORE) else min(values)


def differences(runs: Sequence[TrainingRun]) -> dict[str, list[Any]]:
    """Find the differences of recipes: values by dotted name, one per run; None if a run's recipe lacks it."""
    names = sorted({name for run in runs for name in run.recipe})
    rows = {name: [run.recipe.get(name) for run in runs] for name in names}
    return {name: row for name, row in rows.items() if any(value != row[0] for value in row)}


def measures(runs: Sequence[TrainingRun]) -> list[str]:
    """List the measures on held-out views that any of the runs logged."""
    names = {name for run in runs for name in run.metrics}
    return sorted(name for name in names if name.startswith(("val/", "test/")))


def training_curves(runs: Sequence[TrainingRun]) -> Figure:
    """Draw a plot for each measure of validation and for the training's loss, with a curve for each run.

    Raises:
        ValueError: If the runs logged none.
    """
    names = [name for name in measures(runs) if name.startswith("val/")]
    names += [name for name in ("train/loss", "train/pose") if any(name in run.metrics for run in runs)]
    if not names:
        raise ValueError("the runs logged neither val/… nor train/loss, so there is no curve to draw")
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(4.2 * columns, 3 * rows + 0.5), layout="constrained")
    plots = figure.subplots(rows, columns, squeeze=False).flatten()
    for plot, name in zip(plots, names, strict=False):
        for run in runs:
            points = run.metrics.get(name, [])
            plot.plot(
                *([p[axis] for p in points] for axis in (0, 1)), label=run.name, marker="." * (len(points) < 30) or None
            )
        plot.set(title=name, xlabel="step")
        plot.grid(alpha=0.3)
    for plot in plots[len(names) :]:
        plot.set_visible(False)
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", frameon=False)
    return figure


def _metrics(table: Path) -> dict[str, list[tuple[int, float]]]:
    found: dict[str, list[tuple[int, float]]] = {}
    with table.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            for name, text in row.items():
                if name in (None, "step", "epoch") or not text:
                    continue
                try:
                    found.setdefault(name, []).append((int(row["step"]), float(text)))
                except (KeyError, TypeError, ValueError):
                    raise ValueError(f"{table} is no table of Lightning's: {name} has {text!r}") from None
    return found


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    if isinstance(value, dict) and value:
        return {
            k: v for key, one in value.items() for k, v in _flat(one, f"{name}.{key}" if name else str(key)).items()
        }
    return {name: value}
