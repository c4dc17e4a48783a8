"""Make tables and figures after the paper's, of objects that kfit draws itself."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, progress


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench paper``."""
    parser = ArgumentParser(
        description="Train what is not trained yet, fit unseen procedural objects, and write DIR/README.md with the "
        "tables and figures like those of the paper (Chen et al., ECCV 2020): by kfit's energies and compact networks, "
        "and, in tables whose names begin with paper_, by the paper's configuration (its network sizes, VGG16's "
        "features, a prior of weight 1, λ as printed, 32 starts of 50 steps). Orderings count as reproduced only "
        "outside the noise (paired bootstrap over views, and McNemar's test). "
        "Whatever was trained or measured before is not done again, so that an interrupted run goes on where it "
        "stopped. Tables: 1a (w/o 3D, w/o VAE, full), 1b (code of "
        "4, 16, 128), 2a (energies), backbone (VAE3D against RadianceField), curves (RGB, RGB-D, regressor, "
        "NOCS-style, pose head), robustness (laptops), and paper_1a, paper_1b, paper_2a, paper_curves, "
        "paper_robustness. On a GPU, all of it: --train-steps 6000 --views 150 --seeds 3.",
        epilog="examples, the first overnight on one CPU core, the second some 20 minutes from trained weights:\n"
        "  kfit bench paper --train-steps 900 --starts 8 --steps 30 --hours 10\n"
        "  kfit bench paper --tables '[1a,2a]' --categories '[laptop]' --views 20 --starts 8 --steps 30 --out quick",
    )
    known = ["1a", "1b", "2a", "backbone", "curves", "robustness"]
    parser.add_argument(
        "--tables", type=list[str], default=known, metavar="[NAME,…]", help="which, the most important first"
    )
    parser.add_argument("--seeds", type=int, default=1, help="trainings and views of each row, all of one seed first")
    parser.add_argument(
        "--hours",
        type=float,
        default=None,
        help="begin no row after so many hours; the same command goes on (default: no end)",
    )
    parser.add_argument(
        "--categories", type=list[str], default=["laptop", "mug"], metavar="[NAME,…]", help="of objects"
    )
    parser.add_argument("--train-steps", type=int, default=1500, help="of each training, 32 pairs each")
    parser.add_argument("--objects", type=int, default=4000, help="procedural objects to train on")
    parser.add_argument(
        "--vgg16",
        type=str,
        default=None,
        metavar="FILE",
        help="VGG16's ImageNet weights (torchvision's names) that the regressor starts from, as the paper's did "
        "(default: from nothing)",
    )
    parser.add_argument("--views", type=int, default=60, help="unseen objects a row, one view each")
    parser.add_argument("--starts", type=int, default=16, help="starts a view")
    parser.add_argument("--steps", type=int, default=40, help="steps of a fit")
    parser.add_argument("--seed", type=int, default=0, help="chooses the unseen objects and poses")
    parser.add_argument("--recipes", type=str, default="recipes", help="folder of kfit's recipes", metavar="DIR")
    parser.add_argument("--cache", type=str, default=".kfit_cache", help="folder of rendered views", metavar="DIR")
    parser.add_argument("--runs", type=str, default="paper_runs", help="folder of trainings and figures", metavar="DIR")
    parser.add_argument("--out", type=str, default="kfit_paper", help="folder to write to", metavar="DIR")
    return parser


def run(args: Namespace) -> None:
    """Train and measure what is missing, and write the page."""
    from kfit.bench.paper.fits import Schedule
    from kfit.bench.paper.intervals import pooled
    from kfit.bench.paper.page import figures, page
    from kfit.bench.paper.units import STUDIED, TABLES, Arrays, Measuring
    from kfit.bench.paper.variants import EPOCHS, Training
    from kfit.geometry import CATEGORIES
    from kfit.runtime.atomic_write import atomic_write

    for name, chosen, known in (("tables", args.tables, TABLES), ("categories", args.categories, CATEGORIES)):
        unknown = [word for word in chosen if word not in known]
        if unknown or not chosen:
            raise ValueError(f"--{name}: unknown {', '.join(unknown) or 'nothing'}; known are {', '.join(known)}")
    for name, least in {"views": 1, "starts": 2, "steps": 1, "objects": 2, "seeds": 1}.items():
        if args[name] < least:
            raise ValueError(f"--{name} must be at least {least}, got {args[name]}")
    if args.train_steps < EPOCHS or args.train_steps % EPOCHS:
        raise ValueError(f"--train-steps must be a multiple of {EPOCHS}, got {args.train_steps}")
    if args.vgg16 is not None and not Path(args.vgg16).is_file():
        raise FileNotFoundError(f"--vgg16: there is no file {args.vgg16}")
    if args.vgg16 is None and any(table.startswith("paper_") for table in args.tables):
        raise ValueError("the paper's configuration compares by VGG16's features: give their file by --vgg16")
    if args.hours is not None and args.hours <= 0:
        raise ValueError(f"--hours must be above 0, got {args.hours}")
    begun = time.monotonic()
    training = Training(
        args.train_steps, args.objects, Path(args.recipes), Path(args.cache), Path(args.runs), args.vgg16
    )
    wanted = [
        (category, unit)
        for table in args.tables
        for category in ([STUDIED] if table.endswith("robustness") else args.categories)
        for unit in TABLES[table]
    ]
    ours = [table for table in args.tables if not table.startswith("paper_")]
    with progress() as bar:
        whole, part = bar.add_task("rows", total=args.seeds * len(set(wanted))), bar.add_task("")
        how = Measuring(
            training,
            Schedule(args.starts, args.steps),
            args.views,
            args.seed,
            lambda what, done, total: bar.update(part, description=what, completed=done, total=total),
            "full" if ours else "paper",
        )
        rows: dict[tuple[str, str], list[Arrays]] = {}
        for seed in range(args.seeds):
            one = replace(how, seed=args.seed + seed, training=replace(training, seed=seed))
            for category, unit in dict.fromkeys(wanted):
                if args.hours is not None and time.monotonic() - begun > 3600 * args.hours:
                    break
                rows.setdefault((category, unit), []).append(one.measured(unit, category))
                bar.advance(whole)
    if not rows:
        raise ValueError(f"--hours {args.hours:g} left no time for a row")
    done = min(len(seeds) for seeds in rows.values())
    # Rows are compared view by view, so all are of the same seeds.
    units = {key: pooled(seeds[:done]) for key, seeds in rows.items()}
    left = args.seeds * len(set(wanted)) - sum(map(len, rows.values()))
    if left:
        log.info("%d rows are left; the same command goes on", left)
    text = page(units, args.tables, args.categories, how, _command(args), done).encode()
    writers: dict[str, Callable[[Path], object]] = {"README.md": lambda path: path.write_bytes(text)}
    for name, figure in figures(units, args.tables, args.categories).items():
        writers[f"{name}.png"] = partial(figure.savefig, dpi=110)
    for path in atomic_write(Path(args.out), writers):
        log.info("wrote %s", path)


def _command(args: Namespace) -> str:
    """The command line that repeats the page, without folders."""
    words = ["kfit", "bench", "paper"]
    for name in ("tables", "categories", "train_steps", "objects", "views", "starts", "steps", "seed", "seeds"):
        if args[name] != parser().get_defaults()[name]:
            value = f"[{','.join(args[name])}]" if isinstance(args[name], list) else str(args[name])
            words += [f"--{name.replace('_', '-')}", value]
    words += ["--vgg16", Path(args.vgg16).name] if args.vgg16 else []
    return shlex.join(words)
