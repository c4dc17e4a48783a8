"""Tables of average precision by category: for people, for spreadsheets, and with the curves for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from kfit.geometry import CATEGORIES
from kfit.metrics import NOCSScores

# By category and for the mean: counts, then AP in percent by column.
PrecisionTable = dict[str, dict[str, float]]

# Name of a column, and degrees and centimetres of the pose, or else the overlap.
COLUMNS: dict[str, tuple[float, ...]] = {
    "IoU25": (0.25,),
    "IoU50": (0.5,),
    "IoU75": (0.75,),
    "5°2cm": (5, 2),
    "5°5cm": (5, 5),
    "10°5cm": (10, 5),
    "10°10cm": (10, 10),
    "10°": (10, math.inf),
    "60°": (60, math.inf),
}
# The same free of scale: percent of the diagonal stand for centimetres.
SCALE_AGNOSTIC_COLUMNS: dict[str, tuple[float, ...]] = {
    "NIoU25": (0.25,),
    "NIoU50": (0.5,),
    "NIoU75": (0.75,),
    "5°0.2d": (5, 20),
    "5°0.5d": (5, 50),
    "10°0.2d": (10, 20),
    "10°0.5d": (10, 50),
    "0.2d": (360, 20),
    "10°": (10, math.inf),
    "60°": (60, math.inf),
}


def table_of(score: NOCSScores, columns: Mapping[str, tuple[float, ...]]) -> PrecisionTable:
    """Counts and AP in percent by category, their mean as published, and the mean of those present where it differs.

    Args:
        score: measured at the columns' thresholds.
        columns: by name, the overlap, or else degrees and centimetres.

    Raises:
        ValueError: if the score was not measured at one of them.
    """
    values = {
        name: 100 * (score.iou(limits[0]) if len(limits) == 1 else score.pose(*limits))
        for name, limits in columns.items()
    }
    counts = {"objects": score.num_truths, "predictions": score.num_predictions, "found": score.num_found}
    table: PrecisionTable = {}
    for index, category in enumerate(CATEGORIES):
        row: dict[str, float] = {name: int(count[index]) for name, count in counts.items()}
        table[category] = row | {name: float(value[index]) for name, value in values.items()}
    total = {name: int(count.sum()) for name, count in counts.items()}
    table["mean"] = {**total, **{name: float(value[-1]) for name, value in values.items()}}
    if (score.num_truths == 0).any() and (score.num_truths > 0).any():
        present = {name: score.mean_of_present(value) for name, value in values.items()}
        table["mean of those present"] = {**total, **present}
    return table


def spelled(value: float) -> str:
    """A count, a percentage with one digit, or a dash for what is not defined."""
    return str(value) if isinstance(value, int) else "–" if math.isnan(value) else f"{value:.1f}"


def as_markdown(tables: Mapping[str, PrecisionTable], note: str) -> str:
    """A heading and a table a method, and a note below."""
    text = ""
    for name, table in tables.items():
        head = ["category", *table["mean"]]
        text += f"## {name}\n\n| {' | '.join(head)} |\n|---|{'---:|' * (len(head) - 1)}\n"
        for category, row in table.items():
            text += f"| {' | '.join([category, *map(spelled, row.values())])} |\n"
        text += "\n"
    return text + note + "\n"


def as_csv(tables: Mapping[str, PrecisionTable]) -> str:
    """A line a method and category, in full precision; what is not defined is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "category", *next(iter(tables.values()))["mean"]])
    for name, table in tables.items():
        for category, row in table.items():
            writer.writerow([name, category, *("" if math.isnan(value) else value for value in row.values())])
    return text.getvalue()


def as_json(scores: Mapping[str, NOCSScores], tables: Mapping[str, PrecisionTable], settings: Mapping[str, Any]) -> str:
    """The tables in percent and the curves in [0, 1]; what is not defined is null."""
    methods = {
        name: {
            "table": {category: _defined(row) for category, row in tables[name].items()},
            "iou_curve": {"thresholds": list(score.ious), **_curves(score.iou_ap)},
            "rotation_curve": {"degrees": list(score.degrees[:-1]), **_curves(score.pose_ap[:, :-1, -1])},
            "translation_curve": {"shifts": list(score.shifts[:-2]), **_curves(score.pose_ap[:, -1, :-2])},
        }
        for name, score in scores.items()
    }
    return json.dumps({**settings, "methods": methods}, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _curves(precision: np.ndarray) -> dict[str, list[float | None]]:
    rows = zip((*CATEGORIES, "mean"), precision.tolist(), strict=True)
    return {name: [None if math.isnan(value) else value for value in row] for name, row in rows}


def _defined(row: Mapping[str, float]) -> dict[str, float | None]:
    return {key: None if math.isnan(value) else value for key, value in row.items()}
