"""Make tables and figures after the paper's, of objects that kfit draws itself."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, progress

if TYPE_CHECKING:
    from kfit.bench.paper.units import Arrays, Measuring

# Starts and steps of kfit's fits, and of those in the paper's configuration.
OURS, PUBLISHED = (16, 40), (32, 50)


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench paper``."""
    parser = ArgumentParser(
        description="Train what is not trained yet, fit unseen procedural objects, and write DIR/README.md with the "
        "tables and figures like those of the paper (Chen et al., ECCV 2020): by kfit's energies and compact networks, "
        "and, in tables whose names begin with paper_, by the paper's configuration (its network sizes, VGG16's "
        "features, a prior of weight 1, lambda as printed, 32 starts of 50 steps). An ordering counts as reproduced "
        "only outside the noise (paired bootstrap over views, and McNemar's test). The page is written anew after each "
        "row, and nothing is trained or measured twice: after an interruption the same command goes on. Tables, the "
        "most important first: 1a and paper_1a (w/o 3D, w/o VAE, full), 2a and paper_2a (energies), 1b and paper_1b "
        "(code of 4, 16, 128), curves and paper_curves (RGB, RGB-D, regressor, NOCS-style, pose head), robustness and "
        "paper_robustness (laptops), backbone (VAE3D against RadianceField).",
        epilog="examples: all tables on a GPU, kfit's overnight on one CPU core, and two within some hours\n"
        "  kfit bench paper --vgg16 vgg16.pth --train-steps 6000 --views 150 --seeds 3\n"
        "  kfit bench paper --categories '[laptop,mug]' --train-steps 900 --starts 8 --steps 30 --hours 10\n"
        "  kfit bench paper --tables '[1a,2a]' --categories '[laptop]' --train-steps 300 --views 20 --starts 8 "
        "--steps 30",
    )
    parser.add_argument(
        "--tables",
        type=list[str] | None,
        default=None,
        metavar="[NAME,…]",
        help="which, the most important first (default: all; those of the paper's configuration only with --vgg16)",
    )
    parser.add_argument("--seeds", type=int, default=1, help="trainings and views of each row, all of one seed first")
    parser.add_argument(
        "--hours",
        type=float,
        default=None,
        help="begin no row after so many hours; the same command goes on (default: no end)",
    )
    parser.add_argument(
        "--categories", type=list[str] | None, default=None, metavar="[NAME,…]", help="which (default: all six)"
    )
    parser.add_argument("--train-steps", type=int, default=1500, help="steps of each training, 32 pairs each")
    parser.add_argument("--objects", type=int, default=4000, help="procedural objects to train on")
    parser.add_argument(
        "--vgg16",
        type=str,
        default=None,
        metavar="FILE",
        help="VGG16's ImageNet weights (torchvision's names): the paper's configuration compares their features, and "
        "its regressor starts from them (default: the regressor starts from random weights)",
    )
    parser.add_argument("--views", type=int, default=60, help="unseen objects a row, one view each")
    for number, name in enumerate(("starts", "steps")):
        parser.add_argument(
            f"--{name}",
            type=int | None,
            default=None,
            help=f"{name} of all fits (default: {OURS[number]}, in the paper's configuration {PUBLISHED[number]})",
        )
    parser.add_argument("--seed", type=int, default=0, help="chooses the unseen objects and poses")
    parser.add_argument("--recipes", type=str, default="recipes", help="folder of kfit's recipes", metavar="DIR")
    parser.add_argument("--cache", type=str, default=".kfit_cache", help="folder of rendered views", metavar="DIR")
    parser.add_argument("--runs", type=str, default="paper_runs", help="folder of trainings and figures", metavar="DIR")
    parser.add_argument("--out", type=str, default="kfit_paper", help="folder to write to", metavar="DIR")
    return parser


def run(args: Namespace) -> None:
    """Train and measure what is missing, and write the page after each row."""
    from kfit.bench.paper.fits import Schedule
    from kfit.bench.paper.units import STUDIED, TABLES, Measuring
    from kfit.bench.paper.variants import Training
    from kfit.geometry import CATEGORIES

    categories = list(CATEGORIES) if args.categories is None else args.categories
    tables = list(TABLES) if args.tables is None else args.tables
    if args.tables is None and args.vgg16 is None:
        tables = [table for table in TABLES if not table.startswith("paper_")]
    for name, chosen, known in (("tables", tables, TABLES), ("categories", categories, CATEGORIES)):
        unknown = [word for word in chosen if word not in known]
        if unknown or not chosen:
            raise ValueError(f"--{name}: unknown {', '.join(unknown) or 'nothing'}; known are {', '.join(known)}")
    if args.vgg16 is None and any(table.startswith("paper_") for table in tables):
        raise ValueError("the paper's configuration compares by VGG16's features: give their file by --vgg16")
    _check(args)
    begun = time.monotonic()
    training = Training(
        args.train_steps, args.objects, Path(args.recipes), Path(args.cache), Path(args.runs), args.vgg16
    )
    ours, published = (Schedule(args.starts or starts, args.steps or steps) for starts, steps in (OURS, PUBLISHED))
    base = "paper" if all(table.startswith("paper_") for table in tables) else "full"
    with progress() as bar:
        whole, part = bar.add_task("rows"), bar.add_task("")
        how = Measuring(
            training,
            ours,
            published,
            args.views,
            args.seed,
            lambda what, done, total: bar.update(part, description=what, completed=done, total=total),
            base,
        )
        wanted = [
            (seed, category, unit)
            for seed in range(args.seeds)
            for table in tables
            for category in ([STUDIED] if table.endswith("robustness") else categories)
            for unit in TABLES[table]
        ]
        of_seed = [replace(how, seed=args.seed + n, training=replace(training, seed=n)) for n in range(args.seeds)]
        rows: dict[tuple[int, str, str], Arrays] = {}
        for seed, category, unit in dict.fromkeys(wanted):
            if (found := of_seed[seed].saved(unit, category)) is not None:
                rows[seed, category, unit] = found
        missing = [row for row in dict.fromkeys(wanted) if row not in rows]
        written: list[Path] = []
        bar.update(whole, total=len(missing))
        for done, (seed, category, unit) in enumerate(missing):
            if args.hours is not None and time.monotonic() - begun > 3600 * args.hours:
                log.info("%d rows are left; the same command goes on", len(missing) - done)
                break
            rows[seed, category, unit] = of_seed[seed].measured(unit, category)
            bar.advance(whole)
            log.info("measured %s, %s, seed %d: row %d of %d", category, unit, seed, done + 1, len(missing))
            written = _write(args, tables, categories, rows, how)
    if not rows:
        raise ValueError(f"--hours {args.hours:g} left no time for a row")
    for path in written or _write(args, tables, categories, rows, how):
        log.info("wrote %s", path)


def _check(args: Namespace) -> None:
    """Refuse wrong arguments before anything is trained."""
    from kfit.bench.paper.variants import EPOCHS
    from kfit.runtime.atomic_write import check_folder

    for name, least in {"views": 1, "starts": 2, "steps": 1, "objects": 2, "seeds": 1}.items():
        if args[name] is not None and args[name] < least:
            raise ValueError(f"--{name} must be at least {least}, got {args[name]}")
    if args.train_steps < EPOCHS or args.train_steps % EPOCHS:
        raise ValueError(f"--train-steps must be a multiple of {EPOCHS}, got {args.train_steps}")
    if args.vgg16 is not None and not Path(args.vgg16).is_file():
        raise FileNotFoundError(f"--vgg16: there is no file {args.vgg16}")
    if args.hours is not None and args.hours <= 0:
        raise ValueError(f"--hours must be above 0, got {args.hours}")
    for name in ("cache", "runs", "out"):
        check_folder(f"--{name}", Path(args[name]))


def _write(
    args: Namespace,
    tables: list[str],
    categories: list[str],
    rows: Mapping[tuple[int, str, str], Arrays],
    how: Measuring,
) -> list[Path]:
    """Write the page about the rows that are measured, and its figures."""
    from kfit.bench.paper.figures import figures
    from kfit.bench.paper.intervals import pooled
    from kfit.bench.paper.page import page
    from kfit.runtime.atomic_write import atomic_write

    measured = {(category, unit) for seed, category, unit in rows if seed == 0}
    # Rows are compared view by view, so all are of the same seeds.
    seeds = [seed for seed in range(args.seeds) if all((seed, *row) in rows for row in measured)]
    units = {row: pooled([rows[seed, *row] for seed in seeds]) for row in measured}
    text = page(units, tables, categories, how, _command(args), len(seeds)).encode()
    writers: dict[str, Callable[[Path], object]] = {"README.md": lambda path: path.write_bytes(text)}
    for name, figure in figures(units, tables, categories).items():
        writers[f"{name}.png"] = partial(figure.savefig, dpi=110)
    return atomic_write(Path(args.out), writers)


def _command(args: Namespace) -> str:
    """The command line that repeats the page, without folders."""
    words, defaults = ["kfit", "bench", "paper"], parser().get_defaults()
    for name in ("tables", "categories", "train_steps", "objects", "views", "starts", "steps", "seed", "seeds"):
        if args[name] != defaults[name]:
            value = f"[{','.join(args[name])}]" if isinstance(args[name], list) else str(args[name])
            words += [f"--{name.replace('_', '-')}", value]
    words += ["--vgg16", Path(args.vgg16).name] if args.vgg16 else []
    return shlex.join(words)
