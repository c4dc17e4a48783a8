"""The results page: the paper's tables and figures, with what made them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kfit.bench.accuracy_page import circumstances
from kfit.bench.paper import plots
from kfit.bench.paper.drawings import l1_views
from kfit.bench.paper.intervals import Interval, agreement, difference, share_below
from kfit.bench.paper.units import REFERENCE, ROBUST_VIEWS, STUDIED, TABLES, Measuring
from kfit.bench.paper.variants import VARIANTS

Units = Mapping[tuple[str, str], Mapping[str, NDArray[Any]]]
# What the paper prints of REAL275: L1, AP10, AP60.
PUBLISHED = {
    ("1a", "without_3d"): ("0.109", "1.8", "90.2"),
    ("1a", "without_vae"): ("0.049", "12.3", "92.7"),
    ("1a", "full"): ("0.056", "16.5", "97.1"),
    ("1b", "code_4"): ("0.082", "9.1", "96.6"),
    ("1b", "full"): ("0.056", "16.5", "97.1"),
    ("1b", "code_128"): ("0.041", "11.4", "96.0"),
    ("2a", "full+l1"): ("", "14.3", "85.3"),
    ("2a", "full+l2"): ("", "13.2", "88.3"),
    ("2a", "full+ssim"): ("", "15.8", "92.5"),
    ("2a", "full+no_prior"): ("", "16.2", "95.9"),
    ("2a", "full"): ("", "16.5", "97.1"),
}
# The paper's own configuration is measured against the same numbers.
PUBLISHED |= {
    (f"paper_{table}", unit.replace("full", "paper", 1) if unit.startswith("full") else f"paper_{unit}"): numbers
    for (table, unit), numbers in PUBLISHED.items()
}
TITLES = {
    "paper+l1": "L1, prior",
    "paper+l2": "L2, prior",
    "paper+ssim": "SSIM, prior",
    "paper+no_prior": "VGG16",
    "paper_depth+depth": "the paper's, RGB-D",
    "full+l1": "L1, prior",
    "full+l2": "L2, prior",
    "full+ssim": "SSIM, prior",
    "full+no_prior": "EfficientNet-Lite0",
    "full+kfit": "kfit's own (EfficientNet-Lite0, SSIM, silhouette, prior)",
    "field+kfit": "kfit, RGB",
    "field+depth": "kfit, RGB-D",
}
IN_TABLE = {
    ("paper_2a", "paper"): "VGG16, prior",
    ("2a", "full"): "EfficientNet-Lite0, prior",
    ("curves", "full"): "one energy (EfficientNet-Lite0, prior), compact VAE3D",
}
HEADINGS = {
    "1a": "Table 1a: network architectures",
    "1b": "Table 1b: size of the code",
    "2a": "Table 2a: energies",
    "backbone": "Backbones at one training budget",
    "curves": "Methods compared",
    "robustness": "Robustness",
    "paper_1a": "Table 1a, the paper's configuration",
    "paper_1b": "Table 1b, the paper's configuration",
    "paper_2a": "Table 2a, the paper's configuration",
    "paper_curves": "Methods compared, the paper's configuration",
    "paper_robustness": "Robustness, the paper's configuration",
}


def title_of(unit: str, table: str = "") -> str:
    """What a table calls a unit."""
    if (table, unit) in IN_TABLE:
        return IN_TABLE[table, unit]
    if table == "backbone" and unit.endswith("+kfit"):
        return f"{VARIANTS[unit.partition('+')[0]].title}, kfit's own fit"
    return TITLES.get(unit) or VARIANTS[unit.partition("+")[0]].title


def page(units: Units, tables: list[str], categories: list[str], how: Measuring, command: str, seeds: int = 1) -> str:
    """The page in Markdown; its figures are those of `figures`, by name beside it."""
    trained, schedule = how.training, how.schedule
    made = circumstances(command, {})
    objects, fitted = l1_views(how.views)
    begun = "ImageNet's weights" if trained.vgg16 else "random weights"
    lines = [
        "# Tables after the paper's, on objects that kfit draws itself",
        "",
        f"Made by `{command}`. Every variant is trained on the same {trained.objects} objects for {trained.steps} "
        f"steps ({32 * trained.steps:,} pairs of views), generators beside `FeatureEncoder` instead of the "
        f"paper's encoder, the VGG16 regressor from {begun}, and measured on one view each of {how.views} objects of "
        f"seeds, shape families and texture families held out of training (seed {how.seed}), cut out by their true "
        f"masks. Fits take {schedule.starts} starts on an even grid and {schedule.steps} steps; three eighths of the "
        "starts go on after step 3, an eighth after step 10. Unless a row names another energy, they descend the "
        "features of EfficientNet-Lite0 and 0.02 times the code prior. Tables of *the paper's configuration* have its "
        "network sizes, λ of 0.01 as printed, VGG16's features, a prior of weight 1, and 32 starts of 50 steps with "
        "nothing pruned. The paper's numbers, on REAL275, stand beside the rows that are nearest to them. "
        "kfit's own fit starts as many, the best of four times as many that it draws once, and half of them go on "
        "after step 4. "
        "L1 is that of a view drawn by what the encoder saw in another one, over "
        f"{10 * objects:,} views of held-out families and over as many of new objects of the families that training "
        f"showed, as the paper's test objects are; then, over {fitted} views of held-out families, that of the code "
        "which draws the view itself best. "
        "Symmetric classes, and mugs whose handle is hidden, are measured by their axis. With one object a picture and "
        "no detector, AP at a threshold is the share of views below it. Brackets hold 95 % intervals over the views of "
        f"{seeds} seed{'s' * (seeds > 1)}, each with trainings and views of its own: Wilson's of shares, a paired "
        "bootstrap's of differences. They do not hold the noise of training anew. An ordering of AP10 that the paper "
        "prints counts as reproduced (yes) or contradicted (no) only where the interval of the difference leaves out "
        "0 and McNemar's exact test has p < 0.05. A row of dashes has not been measured yet. "
        f"Machine: {made['machine']['processor']}, {made['machine']['threads']} threads of {made['machine']['cores']} "
        f"cores; torch {made['versions']['torch']}.",
        "",
    ]
    drawn = figures(units, tables, categories)
    for table in tables:
        lines += [f"## {HEADINGS[table]}", ""]
        if table.endswith("robustness"):
            lines += _robustness_rows(units, table)
        else:
            for category in categories:
                lines += _rows(units, table, category)
        lines += [
            f"![{HEADINGS[table]}: {name}]({name}.png)\n" for name in figure_names(table, categories) if name in drawn
        ]
    return "\n".join(lines)


def _rows(units: Units, table: str, category: str) -> list[str]:
    published = any(key[0] == table for key in PUBLISHED)
    head = [category, "L1", "L1, known families", "L1, code fitted", "median", "AP5", "AP10", "AP30", "AP60"]
    head += ["translation, median"]
    head += ["G multiply-adds"] if table == "backbone" else []
    head += ["paper: L1", "AP10", "AP60", "AP10 less the reference's", "as the paper"] if published else []
    lines = [f"| {' | '.join(head)} |", "|---" + "|---:" * (len(head) - 1) + "|"]
    for unit in TABLES[table]:
        if (category, unit) not in units:
            lines.append(f"| {title_of(unit, table)} |" + " – |" * (len(head) - 1))
            continue
        arrays = units[category, unit]
        wrong = np.nan_to_num(arrays["rotation_deg"], nan=180.0)
        l1 = [f"{value:.4f}" for value in arrays["l1"]] if "l1" in arrays else 3 * ["–"]
        shift = f"{np.nanmedian(arrays['translation_cm']):.1f} cm" if "translation_cm" in arrays else "–"
        cells = [title_of(unit, table), *l1, f"{np.median(wrong):.1f}°"]
        cells += [_bracketed(share_below(arrays["rotation_deg"], limit)) for limit in (5, 10, 30, 60)]
        cells += [shift, *(PUBLISHED.get((table, unit), ("", "", "")) if published else ())]
        cells += _compared(units, table, category, unit) if published else []
        if table == "backbone":
            network = units.get((category, unit.partition("+")[0]), {})
            cells += [f"{float(network['multiply_adds']) / 1e9:.2f}" if "multiply_adds" in network else "–"]
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def _bracketed(interval: Interval) -> str:
    return f"{interval.value:.0f} [{interval.low:.0f}, {interval.high:.0f}]"


def _compared(units: Units, table: str, category: str, unit: str) -> list[str]:
    """The difference of AP10 from the reference row's, and whether the paper orders the two alike."""
    reference = REFERENCE[table]
    there = (category, reference) in units and (table, unit) in PUBLISHED
    if unit == reference or not there:
        return ["", ""]
    rows = units[category, unit]["rotation_deg"], units[category, reference]["rotation_deg"]
    printed = float(PUBLISHED[table, unit][1]) - float(PUBLISHED[table, reference][1])
    return [_bracketed(difference(*rows, 10)), agreement(*rows, 10, printed)]


def _robustness_rows(units: Units, table: str) -> list[str]:
    methods = [unit for unit in TABLES[table] if (STUDIED, unit) in units]
    if not methods:
        return ["Not measured yet.", ""]
    names = [name for name in units[STUDIED, methods[0]] if name != "settings"]
    lines = [
        f"Mean (median) rotation error over {len(units[STUDIED, methods[0]][names[0]])} views of {STUDIED}s, at most "
        f"{ROBUST_VIEWS}; *instances* are those of training. The regressor was trained with brightness changed by up "
        "to 40 %, up to 20 % hidden and shifts of up to 25 %, the generator with none of these; its fits start "
        "where the mask is.",
        "",
        f"| change | {' | '.join(title_of(unit) for unit in methods)} |",
        "|---|" + "---:|" * len(methods),
    ]
    for name in names:
        kind, _, strength = name.partition(" ")
        label = "none, instances of training" if kind == "instances" else f"{kind} {100 * float(strength):+.0f} %"
        wrong = [np.nan_to_num(units[STUDIED, unit][name], nan=180.0) for unit in methods]
        cells = [f"{one.mean():.1f}° ({np.median(one):.1f}°)" for one in wrong]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return [*lines, ""]


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
