"""The figures of the results page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kfit.bench.paper import plots
from kfit.bench.paper.titles import title_of
from kfit.bench.paper.units import STUDIED, TABLES

Units = Mapping[tuple[str, str], Mapping[str, NDArray[Any]]]


def figure_names(table: str, categories: list[str]) -> list[str]:
    """The figures that stand below a table."""
    return {
        "1a": ["samples", "iterations"],
        "paper_1a": ["paper_samples", "paper_iterations"],
        "curves": ["rotation", "translation", *(f"answers_{category}" for category in categories)],
        "paper_curves": ["paper_rotation", "paper_translation"],
        "robustness": ["robustness"],
        "paper_robustness": ["paper_robustness"],
    }.get(table, [])


def figures(units: Units, tables: list[str], categories: list[str]) -> dict[str, Figure]:
    """The figures of the tables, by name."""
    made: dict[str, Figure] = {}
    for before, base in (("", "full"), ("paper_", "paper")):
        if f"{before}1a" in tables:
            kinds = dict.fromkeys((*TABLES[f"{before}1a"], *(TABLES[f"{before}1b"] if f"{before}1b" in tables else ())))
            if there := [(c, u) for c in categories for u in kinds if "samples" in units.get((c, u), {})]:
                made[f"{before}samples"] = plots.samples(
                    {f"{c}, {title_of(u)}": units[c, u]["samples"] for c, u in there}
                )
            if paths := {c: units[c, base] for c in categories if (c, base) in units}:
                made[f"{before}iterations"] = plots.iterations(paths)
        if (table := f"{before}curves") in tables:
            methods = {
                c: {title_of(u, table): units[c, u] for u in TABLES[table] if (c, u) in units} for c in categories
            }
            methods = {c: found for c, found in methods.items() if found}
            if methods:
                made[f"{before}rotation"] = plots.curves(methods, "rotation_deg", "rotation error [°]", 60)
                made[f"{before}translation"] = plots.curves(methods, "translation_cm", "translation error [cm]", 20)
        if (table := f"{before}robustness") in tables and (changes := _changes(units, table))[0]:
            made[table] = plots.robustness(*changes)
    boxed = ("field+kfit", "field+depth", "coordinates")
    for category in categories if "curves" in tables else []:
        if all((category, unit) in units for unit in boxed):
            shown = units[category, "field+kfit"]
            answers = {title_of(unit): units[category, unit] for unit in boxed}
            made[f"answers_{category}"] = plots.side_by_side(shown["photos"], shown["camera"], answers)
    return made


def _changes(
    units: Units, table: str
) -> tuple[dict[str, dict[str, tuple[list[float], NDArray[Any]]]], dict[str, NDArray[Any]]]:
    found: dict[str, dict[str, tuple[list[float], NDArray[Any]]]] = {}
    for unit in TABLES[table]:
        if (STUDIED, unit) not in units:
            continue
        arrays = units[STUDIED, unit]
        for kind in ("brightness", "occlusion", "shift"):
            names = [name for name in arrays if name.startswith(kind)]
            strengths = [float(name.split(" ")[1]) for name in names]
            found.setdefault(kind, {})[title_of(unit)] = (strengths, np.stack([arrays[name] for name in names]))
    limits = {"brightness": (-0.4, 0.4), "occlusion": (0.0, 0.2), "shift": (0.0, 0.25)}
    return found, {kind: np.array(limit) for kind, limit in limits.items()}
