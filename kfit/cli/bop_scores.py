"""Scores of results in the format of the BOP challenge, for `kfit evaluate --bop`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jsonargparse import Namespace

from kfit.data.bop import BOPEstimate, read_bop_results, read_models, read_truths, write_bop_results
from kfit.metrics.bop_errors import THRESHOLDS, ObjectErrors, bop_errors
from kfit.runtime.console import log, table_console


def run(args: Namespace) -> None:
    """Score, print, and write scores.json and all estimates as one bop.csv.

    Raises:
        FileNotFoundError, ValueError: for files that are missing or hold something else.
    """
    from rich.table import Table

    from kfit.runtime.atomic_write import atomic_write

    estimates = [one for place in args.predictions for file in _files(Path(place)) for one in read_bop_results(file)]
    if not estimates:
        raise ValueError(f"{', '.join(args.predictions)}: there are no results")
    root = Path(args.bop)
    kinds, truths = {one.obj_id for one in estimates}, read_truths(root, args.split)
    errors = bop_errors(estimates, truths, read_models(root), sorted(kinds))
    if not errors:
        raise ValueError(f"{args.bop}/{args.split} has none of the objects {', '.join(map(str, sorted(kinds)))}")
    header = [f"{degrees:g}° {centimetres:g} cm" for degrees, centimetres in THRESHOLDS]
    table = Table("object", "poses", "found", "median", *header, title=f"{root.name}, {args.split}: recall in %")
    for kind, one in errors.items():
        table.add_row(str(kind), *_row(one))
    joined = ObjectErrors(*(np.concatenate(part) for part in zip(*errors.values(), strict=True)))
    if len(errors) > 1:
        table.add_row("all", *_row(joined))
    text = json.dumps({str(kind): _figures(one) for kind, one in errors.items()} | {"all": _figures(joined)}, indent=2)
    folder = Path(args.out)
    for path in atomic_write(folder, {"scores.json": partial(_write, text=text + "\n")}):
        log.info("wrote %s", path)
    write_bop_results(folder / "bop.csv", sorted(estimates, key=_place))
    log.info("wrote %s", folder / "bop.csv")
    table_console(100).print(table)
    for note in _notes(truths, estimates):
        print(note)


def _notes(
    truths: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]], estimates: Sequence[BOPEstimate]
) -> list[str]:
    """Sentences about what the results leave out."""
    kinds = {one.obj_id for one in estimates}
    absent = sorted({int(thing["obj_id"]) for things in truths.values() for thing in things} - kinds)
    shown = {place for place, things in truths.items() if any(int(thing["obj_id"]) in kinds for thing in things)}
    missing = len(shown - {(one.scene_id, one.im_id) for one in estimates})
    notes = []
    if absent:
        notes.append(f"Not counted, as the results name them nowhere: objects {', '.join(map(str, absent))}.")
    if missing:
        notes.append(f"{missing} of {len(shown)} images with these objects have no results; they count as not found.")
    return notes


def _files(place: Path) -> list[Path]:
    if not place.is_dir():
        return [place]
    files = sorted(place.glob("*.csv"))
    if not files:
        raise FileNotFoundError(f"{place} holds no results of BOP: no *.csv")
    return files


def _place(one: BOPEstimate) -> tuple[int, int, int]:
    return one.scene_id, one.im_id, one.obj_id


def _row(one: ObjectErrors) -> list[str]:
    figures = _figures(one)
    median = "–" if figures["median_deg"] is None else f"{figures['median_deg']:.1f}°, {figures['median_cm']:.1f} cm"
    recalls = [f"{100 * one.recall(*limits):.0f}" for limits in THRESHOLDS]
    return [str(len(one.rotation_deg)), f"{100 * float(figures['found'] or 0):.0f} %", median, *recalls]


def _figures(one: ObjectErrors) -> Mapping[str, float | None]:
    there = np.isfinite(one.rotation_deg)
    medians = {
        f"median_{unit}": float(np.median(values[there])) if there.any() else None
        for unit, values in (("deg", one.rotation_deg), ("cm", one.translation_cm))
    }
    recalls = {f"recall_{degrees:g}deg_{shift:g}cm": one.recall(degrees, shift) for degrees, shift in THRESHOLDS}
    found = float(there.mean())
    return {"poses": float(len(there)), "found": found, **medians, **recalls}


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
