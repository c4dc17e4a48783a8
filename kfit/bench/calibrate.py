"""Measure how often a model's answers are right, and write it into its card, so that confidence is calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import progress, table_console


def parser() -> ArgumentParser:
    """Arguments of ``kfit calibrate``."""
    parser = ArgumentParser(
        description="Fit views of unseen procedural objects as `kfit pose` does, fit to them a logistic model of when "
        "an answer is within 20° of the truth, write it into the model's card, and print by cross-validation how often "
        "answers of which confidence are right. The whole rotation counts, also of mugs whose handle is hidden.",
        epilog="examples:\n  kfit calibrate --model mug.safetensors --views 200\n"
        "  kfit calibrate --model mug.safetensors --seed 0 --check",
    )
    parser.add_argument(
        "--model",
        type=str,
        required=True,
        metavar="FILE.safetensors",
        help="the model, whose card beside it is written to",
    )
    parser.add_argument("--views", type=int, default=200, help="number of objects, one view each")
    parser.add_argument("--seed", type=int, default=7, help="chooses the objects and poses")
    parser.add_argument("--depth", action="store_true", help="calibrate fits to depth too")
    parser.add_argument("--check", action="store_true", help="try what the card holds on these views; write nothing")
    return parser


def run(args: Namespace) -> None:
    """Fit the views, calibrate or check, and print the table."""
    if not args.model.endswith(".safetensors"):
        raise ValueError(f"--model must name a .safetensors file, got {args.model}")
    if args.views < 2:
        raise ValueError(f"--views must be at least 2, got {args.views}")
    import torch

    from kfit.bench.held_out_views import RIGHT_DEG, held_out_views, rotation_errors
    from kfit.geometry import rotation_error
    from kfit.models import load
    from kfit.pose.calibrating import calibrate, reliability
    from kfit.pose.confidence import evidence, how_fitted
    from kfit.pose.hypotheses import fitted_rotations
    from kfit.runtime.atomic_write import atomic_write

    model = load(args.model)
    kind = "RGB-D" if args.depth else "RGB"
    before = model.card.calibration.get(kind)
    if args.check and before is None:
        raise ValueError(f"--check: the card of {args.model} holds no calibration of {kind} fits")
    pipeline = model.pipeline(depth=args.depth)
    with progress() as bar:
        task = bar.add_task("drawing", total=args.views)
        views = held_out_views(model, args.views, args.seed, on_view=lambda done: bar.update(task, completed=done))
        bar.reset(task, description="fitting")
        _, results = rotation_errors(model, views, pipeline, on_batch=lambda done: bar.update(task, completed=done))
    told, right, energy = [], [], []
    upright, pose_log_probabilities = (
        torch.eye(3, dtype=torch.float64),
        model.pose_log_probabilities(views.observation.image),
    )
    fits = (result.of(row) for result in results for row in range(len(result.energy)))
    for number, fit in enumerate(fits):
        if fit.start[0] < 0:
            continue  # there is no answer to be sure of
        hypotheses = model.hypotheses(
            fit, upright, None if pose_log_probabilities is None else pose_log_probabilities[number : number + 1]
        )
        told.append(evidence(hypotheses.alternatives, hypotheses.seen))
        # The whole rotation, also of mugs whose handle is hidden: a guess at it is no answer to be sure of.
        error = rotation_error(fitted_rotations(fit.values)[0], views.rotation[number], model.card.known.symmetry)
        right.append(float(error.rad2deg()) < RIGHT_DEG)
        energy.append(float(fit.energy[0]))
    if args.check and before is not None:
        print_reliability(reliability([before.probability(one) for one in told], right), "the card's calibration")
        over = sum(one > before.energy_99 for one in energy) / len(energy)
        print(f"{100 * over:.0f} % of the views have an energy above the card's {before.energy_99:.3f}")
        return
    weights = {name: float(weight) for name, weight in pipeline.weights.items() if weight}  # type: ignore[arg-type]
    model.card.calibration[kind] = calibrate(told, right, energy, how_fitted(results[0], weights), args.seed)
    card = Path(args.model).with_suffix(".json")
    atomic_write(card.parent, {card.name: model.card.write})
    print_reliability(model.card.calibration[kind].measured, "by cross-validation")


def print_reliability(found: dict[str, Any], how: str) -> None:
    """Print what `kfit.pose.calibrating.reliability` found."""
    from rich.table import Table

    table = Table("confidence", "answers", "on average", "within 20°", title=how)
    for row in found["bins"]:
        span = f"{100 * row['from']:.0f} to {100 * row['to']:.0f} %"
        table.add_row(span, str(row["number"]), f"{100 * row['args']:.0f} %", f"{100 * row['right']:.0f} %")
    table_console(100).print(table)
    print(
        f"{100 * found['right']:.0f} % of {sum(row['number'] for row in found['bins'])} are within 20°; calibration "
        f"error {100 * found['calibration error']:.1f} %; Brier score {found['brier']:.3f}, of the share said of all "
        f"{found['brier of the share']:.3f}"
    )
