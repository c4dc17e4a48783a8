"""Compare trainings: differences of their recipes, their results and curves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, table_console

if TYPE_CHECKING:
    from rich.table import Column

    from kfit.reports.training_runs import TrainingRun


def parser() -> ArgumentParser:
    """Arguments of ``kfit compare``."""
    parser = ArgumentParser(
        description="Print the differences of the recipes of trainings, and the last and best value of each measure on "
        "held-out views; draw their curves.",
        epilog="example:\n  kfit compare lightning_logs/version_0 lightning_logs/version_1 --curves curves.png",
    )
    parser.add_argument("folders", type=str, nargs="+", metavar="RUN", help="folders such as lightning_logs/version_0")
    parser.add_argument("--curves", type=str, default=None, metavar="FILE", help="a .png, .svg or .pdf file to write")
    return parser


def run(args: Namespace) -> None:
    """Print the tables, and write the curves where they are wanted."""
    curves = None if args.curves is None else Path(args.curves)
    if curves is not None and curves.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ValueError(f"--curves must name a .png, .svg or .pdf file, got {args.curves}")
    from rich.table import Column, Table

    from kfit.reports.training_runs import TrainingRun, differences, measures, training_curves
    from kfit.runtime.atomic_write import atomic_write

    runs = [TrainingRun.of(folder) for folder in dict.fromkeys(args.folders)]
    console = table_console(60 + 30 * len(runs))
    if len(runs) > 1:
        recipes = Table(Column("recipe", overflow="fold"), *_columns(runs), title="Where the recipes differ")
        for name, values in differences(runs).items():
            recipes.add_row(name, *(_spelled(value) for value in values))
        console.print(recipes) if recipes.row_count else print("The recipes do not differ.")
    results = Table("measure", *_columns(runs), title="Last (best)")
    for name in measures(runs):
        results.add_row(name, *(_pair(run.last(name), run.best(name)) for run in runs))
    console.print(results) if results.row_count else print("Nothing was measured on held-out views.")
    if curves is not None:
        figure = training_curves(runs)
        kind = curves.suffix[1:].lower()
        (path,) = atomic_write(curves.parent, {curves.name: partial(figure.savefig, format=kind, dpi=120)})
        log.info("wrote %s", path)


def _columns(runs: Sequence[TrainingRun]) -> list[Column]:
    """Columns of one table; rich keeps a table's cells in them."""
    from rich.table import Column

    return [Column(run.name, overflow="fold") for run in runs]


def _pair(last: float | None, best: float | None) -> str:
    return "–" if last is None or best is None else f"{last:.4g} ({best:.4g})"


def _spelled(value: Any) -> str:
    return "–" if value is None else str(value)
