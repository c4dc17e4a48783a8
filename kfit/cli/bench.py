"""Measure: models on objects that they have never seen, optimizers, and image registration."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from jsonargparse import ArgumentParser, Namespace

from kfit.cli import bench_optimizers, bench_paper, bench_registration

BENCHMARKS = {"optimizers": bench_optimizers, "registration": bench_registration, "paper": bench_paper}


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench``."""
    return ArgumentParser(description="Measure models, optimizers and image registration.")


def add_benchmarks(parser: ArgumentParser) -> None:
    """Add the benchmarks to the parser of ``kfit bench``, which must have its place in the tree by then."""
    commands = parser.add_subcommands(metavar="WHAT", help="what to measure")
    commands.add_subcommand("accuracy", _accuracy_parser(), help="rotation errors on unseen procedural objects")
    for name, benchmark in BENCHMARKS.items():
        commands.add_subcommand(name, benchmark.parser(), help=str(benchmark.__doc__).partition("\n")[0])


def _accuracy_parser() -> ArgumentParser:
    parser = ArgumentParser(
        description="Fit views of procedural objects whose seeds, shape families and texture families were held out of "
        "training, and print the median rotation error and the shares under 5°, 10°, 30° and 60°. Symmetric classes "
        "are judged by their axis; mugs on the views that show the handle (at least 2 % of the mask), and on all."
    )
    parser.add_argument("--category", type=str, default=None, help="a bundled model")
    parser.add_argument("--model", type=str, default=None, help="a .safetensors model of your own")
    parser.add_argument("--views", type=int, default=100, help="number of objects, one view each")
    parser.add_argument("--starts", type=int, default=32, help="starts a view")
    parser.add_argument("--steps", type=int, default=50, help="steps of the optimizer")
    parser.add_argument("--depth", action="store_true", help="fit depth too, as `kfit pose --depth` does")
    parser.add_argument("--prune", type=bool, default=True, help="drop unlikely starts on the way, as `kfit pose` does")
    parser.add_argument("--seed", type=int, default=0, help="chooses the objects and poses")
    parser.add_argument("--card", action="store_true", help="write the figures into the card of --model")
    return parser


def run(said: Namespace) -> None:
    """Run the benchmark that was asked for."""
    chosen = said[said.subcommand]
    if said.subcommand in BENCHMARKS:
        BENCHMARKS[said.subcommand].run(chosen)
    else:
        accuracy(chosen)


def accuracy(said: Namespace) -> None:
    """Measure, print a table, and note it in the card if asked to."""
    if (said.category is None) == (said.model is None):
        raise ValueError("say what to measure: either --category NAME or --model FILE.safetensors")
    if said.card and said.model is None:
        raise ValueError("--card needs --model FILE.safetensors, whose card is written to")
    if said.views < 1:
        raise ValueError(f"--views must be at least 1, got {said.views}")
    import torch
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from kfit.metrics import summary
    from kfit.models import load
    from kfit.models.accuracy import RIGHT_DEG, called_ambiguous, rotation_errors, translation_errors, unseen_views

    model = load(said.model or said.category)
    views = unseen_views(model, said.views, said.seed)
    pipeline = model.pipeline(said.starts, said.steps, None if said.prune else (), said.depth)
    console = Console(stderr=True)
    begun = time.perf_counter()
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("fitting", total=said.views)
        errors, results = rotation_errors(
            model, views, pipeline, on_batch=lambda done: bar.update(task, completed=done)
        )
    spent = (time.perf_counter() - begun) / said.views
    drawn = sum(result.num_evaluations for result in results) / said.views
    shares = {"all views": summary(errors)}
    if not bool(views.visible.all()) and bool(views.visible.any()):
        shares["views that show the handle"] = summary(errors[views.visible])
    counts = {"all views": len(errors), "views that show the handle": int(views.visible.sum())}
    table = Table("views", "number", "median", "< 5°", "< 10°", "< 30°", "< 60°", title=model.card.category)
    for name, row in shares.items():
        table.add_row(
            name,
            str(counts[name]),
            f"{row['median']:.1f}°",
            *(f"{100 * row[f'under_{t}']:.0f} %" for t in (5, 10, 30, 60)),
        )
    Console(width=110).print(table)
    away = 100 * translation_errors(model, views, results).nanmedian()
    print(f"median translation error {away:.1f} cm at {100 * views.distance.median():.0f} cm")
    told, right = called_ambiguous(model, views, results), errors < RIGHT_DEG
    ambiguous = {
        name: {"number": int(group.sum()), "called ambiguous": float(told[group].double().mean())}
        for name, group in {
            f"answers within {RIGHT_DEG:g}°": right,
            "other answers": ~right,
            "hidden handles": ~views.visible,
        }.items()
        if bool(group.any())
    }
    for name, row in ambiguous.items():
        print(f"{100 * row['called ambiguous']:.0f} % of {row['number']} {name} are called ambiguous")
    print(f"{drawn:.0f} pictures drawn and {spent:.2f} s a view, {torch.get_num_threads()} threads")
    if said.card:
        schedule = {"starts": said.starts, "steps": said.steps, "pruned": said.prune, "seed": said.seed}
        what = "unseen procedural objects, held-out families" + (", with depth" if said.depth else "")
        model.card.accuracy[what] = {
            **schedule,
            "median translation error in cm": float(away),
            **{name: {"number": counts[name], **row} for name, row in shares.items()},
            "called ambiguous": ambiguous,
        }
        model.card.write(Path(said.model).with_suffix(".json"))
        print(json.dumps(shares), file=sys.stderr)
