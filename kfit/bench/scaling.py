"""How the cost of a fit grows with objects, starts, steps, code and picture size, and what a second process gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command
from kfit.bench.accuracy_page import Section
from kfit.bench.page import show, write_page
from kfit.runtime.console import progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOT = "scaling.png"


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench scaling``."""
    parser = ArgumentParser(
        description="Fit views of unseen objects while the number of objects, starts or steps, the size of the code or "
        "that of the pictures grows, the rest staying as it is, and measure seconds and memory; then fit by one and by "
        "two processes of one thread.",
        epilog="example:\n  kfit bench scaling --category mug --out scaling",
    )
    parser.add_argument("--category", type=str, default="laptop", help="the bundled model")
    parser.add_argument("--fits", type=int, default=5, help="fits of each process")
    parser.add_argument(
        "--out", type=str, default=None, metavar="DIR", help=f"write README.md and {PLOT} there (default: nowhere)"
    )
    return parser


def run(args: Namespace) -> None:
    """Measure, print the tables, and write them and the plot where they are wanted."""
    if args.fits < 1:
        raise ValueError(f"--fits must be at least 1, got {args.fits}")

    from kfit.bench.fit_scaling import AXES, DEFAULTS, cost_of, rate_of_processes
    from kfit.models import load

    model = load(args.category)
    found: dict[str, list[tuple[int, float, float | None]]] = {}
    with progress() as bar:
        task = bar.add_task("scaling", total=sum(map(len, AXES.values())) + 2)
        for axis, values in AXES.items():
            for value in values:
                bar.update(task, description=f"{value} {axis}" if axis.endswith("s") else f"{axis} {value}")
                cost = cost_of(model, {**DEFAULTS, axis: value})
                found.setdefault(axis, []).append((value, cost.seconds, cost.megabytes))
                bar.advance(task)
        rates = {}
        for count in (1, 2):
            bar.update(task, description=f"{count} processes")
            rates[count] = rate_of_processes(args.category, count, args.fits)
            bar.advance(task)
    tables = sections(found, rates, DEFAULTS)
    show(tables, 120)
    if args.out:
        drawn, repeat = figure(found), command("scaling", args, parser().get_defaults())
        write_page(
            args.out,
            "How the cost of a fit grows",
            repeat,
            tables,
            [f"![seconds and memory over each size]({PLOT})", ""],
            {PLOT: lambda path: drawn.savefig(path, dpi=110)},
        )


def sections(
    found: dict[str, list[tuple[int, float, float | None]]], rates: dict[int, float], defaults: dict[str, int]
) -> list[Section]:
    """A table of sizes, seconds and memory, and one of processes."""
    rows = []
    for axis, points in found.items():
        for value, seconds, memory in points:
            memory_text = "unknown" if memory is None else f"{memory:.0f}"
            rows.append([axis, str(value), f"{seconds:.2f}", f"{seconds / points[0][1]:.1f} ×", memory_text])
    others = ", ".join(f"{name} {value}" for name, value in defaults.items())
    grown = Section(
        "Sizes",
        ["what grows", "to", "s a fit", "of the first", "MB at most"],
        rows,
        [f"The rest stays at {others}. Memory is the whole process's, PyTorch, weights and all."],
    )
    more = [[str(count), f"{rate:.2f}", f"{rate / rates[1]:.2f} ×"] for count, rate in rates.items()]
    return [grown, Section("Processes of one thread", ["processes", "fits a second", "of one"], more)]


def figure(found: dict[str, list[tuple[int, float, float | None]]]) -> Figure:
    """A plot for each size: seconds, and memory on an axis of its own."""
    from matplotlib.figure import Figure

    whole = Figure(figsize=(3 * len(found), 3), layout="constrained")
    for plot, (axis, points) in zip(whole.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        sizes, seconds, memory = zip(*points, strict=True)
        plot.plot(sizes, seconds, "o-", color="#4477aa")
        plot.set(xlabel=axis, ylim=(0, 1.1 * max(seconds)), xlim=(0, 1.05 * max(sizes)))
        plot.set_ylabel("s a fit", color="#4477aa")
        plot.spines["top"].set_visible(False)
        plot.grid(alpha=0.3)
        if None not in memory:
            right = plot.twinx()
            right.plot(sizes, memory, "s--", color="#ee6677")
            right.set(ylim=(0, 2 * max(memory)))
            right.set_ylabel("MB at most", color="#ee6677")
            right.spines["top"].set_visible(False)
    return whole
