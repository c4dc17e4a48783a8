"""The results page: the paper's tables and figures, with what made them."""

from __future__ import annotations

import numpy as np

from kfit.bench.accuracy_page import circumstances
from kfit.bench.paper.drawings import l1_views
from kfit.bench.paper.figures import Units, figure_names, figures
from kfit.bench.paper.intervals import Interval, agreement, difference, mean_of, share_below
from kfit.bench.paper.titles import HEADINGS, PUBLISHED, title_of
from kfit.bench.paper.units import REFERENCE, ROBUST_VIEWS, STUDIED, TABLES, Measuring


def page(units: Units, tables: list[str], categories: list[str], how: Measuring, command: str, seeds: int = 1) -> str:
    """The page in Markdown; its figures are those of `figures`, by name beside it."""
    lines = ["# Tables after the paper's, on objects that kfit draws itself", "", *_summary(units, tables, categories)]
    lines += _settings(tables, how, command, seeds)
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


def _summary(units: Units, tables: list[str], categories: list[str]) -> list[str]:
    """Which of the paper's orderings are reproduced; nothing where no two rows can be compared."""
    found: dict[str, list[str]] = {"reproduced": [], "contradicted": [], "within the noise": []}
    for table in tables:
        for category in categories:
            for unit in TABLES[table]:
                if (outcome := _compared(units, table, category, unit)[1]) in found:
                    found[outcome].append(f"{title_of(unit, table)} ({category}, table {table})")
    total = sum(map(len, found.values()))
    if not total:
        return []
    lines = [f"Of {total} orderings by AP10 that the paper prints and that were measured here:", ""]
    for outcome, named in found.items():
        which = f": {'; '.join(named)}" if named and outcome != "within the noise" else ""
        lines.append(f"- **{len(named)} {outcome}**{which}")
    return [*lines, ""]


def _settings(tables: list[str], how: Measuring, command: str, seeds: int) -> list[str]:
    trained, ours, published = how.training, how.schedule, how.published
    made = circumstances(command, {})
    objects, fitted = l1_views(how.views)
    begun = "ImageNet's weights" if trained.vgg16 else "random weights"
    counted = f"of seed {how.seed}" if seeds == 1 else f"and a training of its own for each of {seeds} seeds"
    machine, versions = made["machine"], made["versions"]
    lines = [
        f"Made by `{command}` on {machine['processor']} ({machine['threads']} threads of {machine['cores']} cores), "
        f"torch {versions['torch']}.",
        "",
        f"- **Trainings**: each variant on the same {trained.objects} procedural objects, {trained.steps} steps "
        f"({32 * trained.steps:,} pairs of views).",
        f"- **Views**: {how.views} objects {counted}, one view each, of shape and texture families held out of "
        "training, cut out by their true masks. Symmetric classes, and mugs whose handle is hidden, are measured by "
        "their axis. With one object a picture and no detector, AP at a threshold is the share of views below it in %.",
    ]
    if any(not table.startswith("paper_") for table in tables):
        lines.append(
            f"- **kfit's rows**: compact networks with `FeatureEncoder`; fits of {ours.starts} starts on an even "
            f"grid and {ours.steps} steps; three eighths of the starts go on after step 3, an eighth after step 10. "
            "Unless a row names another energy, they minimise features of EfficientNet-Lite0 and 0.02 times the code "
            "prior. kfit's own fit starts with the best of four times as many candidates and keeps half after step 4."
        )
    if any(table.startswith("paper_") for table in tables):
        lines.append(
            "- **The paper's configuration**: its network sizes, λ of 0.01 as printed, in the released code's "
            "normalisation, features of VGG16 and a prior of weight 1 (in proportion for other energies), "
            f"{published.starts} starts of {published.steps} steps (the paper: 32 of 50), nothing pruned."
        )
    if any("curves" in table or "robustness" in table for table in tables):
        lines.append(f"- **The VGG16 regressor** is trained from {begun}.")
    lines += [
        "- **L1**: of a view from four diagonals away drawn by the code of another view, over "
        f"{10 * objects:,} views of held-out families, then of families that training showed, as the paper's test "
        f"objects are; then of {fitted} views of held-out families, each drawn by the code that fits it best.",
        "- **Brackets**: 95 % intervals over the views; Wilson's of shares, a paired bootstrap's of differences, a "
        "bootstrap's of means. They do not include the variation between trainings. Bands in plots are these intervals "
        "too; around iterations they hold the middle half of the views.",
    ]
    if any(key[0] in tables for key in PUBLISHED):
        lines += [
            "- **Paper**: its numbers are those of REAL275, in the rows that are nearest to them.",
            "- **ΔAP10**: AP10 less that of the table's reference row. An ordering is *reproduced* or *contradicted* "
            "only if the interval of ΔAP10 excludes 0 and McNemar's exact test has p < 0.05, without a correction for "
            "the number of orderings; otherwise it is *within the noise*.",
        ]
    return [*lines, "- A row of dashes is not measured yet.", ""]


def _rows(units: Units, table: str, category: str) -> list[str]:
    published = any(key[0] == table for key in PUBLISHED)
    head = [category, "L1", "L1, known families", "L1, code fitted", "median", "AP5", "AP10", "AP30", "AP60"]
    head += ["translation, median"]
    head += ["G multiply-adds"] if table == "backbone" else []
    head += ["ΔAP10", "ordering", "paper: L1", "paper: AP10", "paper: AP60"] if published else []
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
        cells.append(shift)
        if published:
            cells += [*_compared(units, table, category, unit), *PUBLISHED.get((table, unit), ("", "", ""))]
        if table == "backbone":
            network = units.get((category, unit.partition("+")[0]), {})
            cells += [f"{float(network['multiply_adds']) / 1e9:.2f}" if "multiply_adds" in network else "–"]
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def _bracketed(interval: Interval) -> str:
    return f"{interval.value:.0f} [{interval.low:.0f}, {interval.high:.0f}]"


def _compared(units: Units, table: str, category: str, unit: str) -> tuple[str, str]:
    """The difference of AP10 from the reference row's, and whether the paper orders the two alike."""
    reference = REFERENCE.get(table, "")
    measured = {(category, unit), (category, reference)} <= units.keys() and (table, unit) in PUBLISHED
    if unit == reference or not measured:
        return "", "reference" * (unit == reference and measured)
    rows = units[category, unit]["rotation_deg"], units[category, reference]["rotation_deg"]
    printed = float(PUBLISHED[table, unit][1]) - float(PUBLISHED[table, reference][1])
    return _bracketed(difference(*rows, 10)), agreement(*rows, 10, printed)


def _robustness_rows(units: Units, table: str) -> list[str]:
    methods = [unit for unit in TABLES[table] if (STUDIED, unit) in units]
    if not methods:
        return ["Not measured yet.", ""]
    names = [name for name in units[STUDIED, methods[0]] if name != "settings"]
    lines = [
        "Mean rotation error with a bootstrap's 95 % interval, and median, over "
        f"{len(units[STUDIED, methods[0]][names[0]])} views of {STUDIED}s (at most {ROBUST_VIEWS} a seed). The "
        "regressor was trained with brightness changed by up to 40 %, up to 20 % hidden and shifts of up to 25 %, the "
        "generator with none of these; its fits start where the mask is.",
        "",
        f"| change | {' | '.join(title_of(unit) for unit in methods)} |",
        "|---|" + "---:|" * len(methods),
    ]
    for name in names:
        kind, _, strength = name.partition(" ")
        label = f"{kind} {100 * float(strength):+.0f} %"
        if not float(strength):
            label = "none, objects of training" if kind == "instances" else f"{kind} unchanged"
        wrong = [np.nan_to_num(units[STUDIED, unit][name], nan=180.0) for unit in methods]
        cells = [f"{_bracketed(mean_of(one))}°, {np.median(one):.0f}°" for one in wrong]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return [*lines, ""]
