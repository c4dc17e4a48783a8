"""Where energies have their minimum: rotation errors of fits that start near the truth, and the rank of the truth."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command, models_of
from kfit.bench.accuracy_page import Section
from kfit.runtime.console import progress

if TYPE_CHECKING:
    from torch import Tensor

    from kfit.bench.minimum_fits import Candidate
    from kfit.core import FitResult, Observation, Variables
    from kfit.fitting.pipeline import FitPipeline
    from kfit.pose import CategoryModel

BATCH = 10


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench minimum``."""
    parser = ArgumentParser(
        description="Start fits of unseen upright objects a few degrees off the truth, everything else true and the "
        "code free, and compare rotation errors before and after by several energies, and by learned steps. Then draw "
        "32 poses, the true one, flips and others within 30°, and rank the true one by each energy.",
        epilog="example:\n  kfit bench minimum --categories '[mug]' --views 20",
    )
    parser.add_argument(
        "--categories", type=list[str], default=["camera", "laptop", "mug"], metavar="[NAME,…]", help="bundled models"
    )
    parser.add_argument(
        "--model", type=str, default=None, metavar="FILE.safetensors", help="a model of your own instead"
    )
    parser.add_argument(
        "--refiner",
        type=str,
        default=None,
        metavar="FILE",
        help="weights of kfit.features.PoseRefiner, a .ckpt or .safetensors file, for learned steps and the learned "
        "score (default: without)",
    )
    parser.add_argument("--views", type=int, default=100, help="objects a category, a view each")
    parser.add_argument("--off", type=float, default=8.0, help="degrees from the truth at which fits start")
    parser.add_argument("--seed", type=int, default=0, help="chooses the objects, poses and starts")
    parser.add_argument("--out", type=str, default=None, metavar="DIR", help="write README.md there (default: nowhere)")
    return parser


def run(args: Namespace) -> None:
    """Measure, print the tables, and write them where they are wanted."""
    from kfit.core.check import check_count, check_range

    check_count("--views", args.views)
    check_range("--off", args.off, 0, 180)
    check_count("--seed", args.seed, 0)
    from kfit.bench.page import show, write_page

    chosen = Namespace(**{**vars(args), "categories": None if args.model else args.categories})
    models = models_of(chosen)
    with progress() as bar:
        found = {category: _measured(args, model, bar) for category, model in models.items()}
    tables = [_fits_section(args.off, found), _ranks_section(found)]
    show(tables, 120)
    if args.out:
        repeated = command("minimum", chosen, parser().get_defaults())
        lines = [f"{args.views} views of unseen objects of held-out families a category, upright, seed {args.seed}."]
        write_page(args.out, "Where energies have their minimum", repeated, tables, [*lines, ""])


def _measured(args: Namespace, model: CategoryModel, bar: Any) -> dict[str, dict[str, Tensor]]:
    """Rotation errors (N,) before and after, by candidate, and for each energy ranks (N,) of the truth."""
    import torch

    from kfit.bench import minimum_fits as fits
    from kfit.bench.held_out_views import held_out_views
    from kfit.features import PoseRefiner

    refiner = None if args.refiner is None else PoseRefiner(args.refiner)
    compared = fits.candidates(refiner is not None)
    task = bar.add_task(f"{model.card.category}, drawing", total=args.views)
    views = held_out_views(model, args.views, args.seed, on_view=partial(_show, bar, task))
    bar.reset(task, description=model.card.category, total=2 * len(compared))
    truth, rng = fits.true_poses(model, views), torch.Generator().manual_seed(args.seed)
    start = fits.rotated_poses(truth, fits.off_by(views.rotation, args.off, rng))
    poses = fits.rotated_poses(truth, fits.around(views.rotation, rng))
    found: dict[str, dict[str, Tensor]] = {"before": {"error": fits.errors_of(model, views, start)}}
    ranked = []
    for name, candidate in compared.items():
        make = partial(fits.fit_from, model, refiner=refiner)
        results = fitted(make, candidate, start, 1, views.observation)
        values = {key: torch.cat([result.values[key] for result in results]) for key in start}
        found[name] = {"error": fits.errors_of(model, views, values)}
        bar.advance(task)
        if candidate.weights not in ranked:  # candidates of one energy differ in how it is descended
            ranked.append(candidate.weights)
            only_ranks = candidate._replace(learned=0, descended=0)
            results = fitted(make, only_ranks, poses, fits.NUM_POSES, views.observation)
            found[name]["rank"] = torch.cat([_rank(result) for result in results])
        bar.advance(task)
    return found


def fitted(
    make: Any, candidate: Candidate, poses: Variables, num_starts: int, observation: Observation
) -> list[FitResult]:
    """Fit all problems, in batches."""
    results = []
    for first in range(0, observation.num_problems, BATCH):
        rows = slice(first * num_starts, (first + BATCH) * num_starts)
        pipeline: FitPipeline = make(candidate, {name: value[rows] for name, value in poses.items()}, num_starts)
        results.append(pipeline(observation[first : first + BATCH], seed=0))
    return results


def _rank(result: FitResult) -> Tensor:
    """Rank (B,) of start 0 of each problem by energy, from 1."""
    from kfit.bench.minimum_fits import NUM_POSES

    order = (result.all_problem * NUM_POSES + result.all_start).argsort()
    energy = result.all_energy[order].unflatten(0, (-1, NUM_POSES))
    rank: Tensor = 1 + (energy[:, 1:] < energy[:, :1]).sum(1)
    return rank


def _show(bar: Any, task: Any, done: int) -> None:
    bar.update(task, completed=done)


def _fits_section(off: float, found: dict[str, dict[str, dict[str, Tensor]]]) -> Section:
    header = ["fit", *(f"{category}: {what}" for category in found for what in ("median", "< 5°", "< 10°"))]
    first = next(iter(found.values()))
    rows = []
    for name in first:
        row = [name]
        for measured in found.values():
            error = measured[name]["error"]
            shares = (100 * float((error < limit).double().mean()) for limit in (5, 10))
            row += [f"{float(error.median()):.1f}°", *(f"{share:.0f} %" for share in shares)]
        rows.append(row)
    return Section(f"Rotation errors of fits that start {off:g}° off", header, rows)


def _ranks_section(found: dict[str, dict[str, dict[str, Tensor]]]) -> Section:
    header = ["energy", *(f"{category}: {what}" for category in found for what in ("first", "mean rank"))]
    rows, first = [], next(iter(found.values()))
    for name in (name for name in first if "rank" in first[name]):
        row = [name]
        for measured in found.values():
            rank = measured[name]["rank"].float()
            row += [f"{100 * float((rank == 1).float().mean()):.0f} %", f"{float(rank.mean()):.1f}"]
        rows.append(row)
    return Section("Rank of the true pose among 32, by the energy", header, rows)
