"""Measure how often a model's answers are right, which calibrates the confidence in its card."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, progress, table_console

# An answer of at least this confidence is taken for certain.
CONFIDENT = 0.8


def parser() -> ArgumentParser:
    """Arguments of ``kfit calibrate``."""
    parser = ArgumentParser(
        description="Fit views of unseen objects, procedural ones or meshes, as `kfit pose` does: upright, on a table, "
        "from anywhere, occluded, cut off, badly masked, and things of other categories. Fit to them a logistic model "
        "of when an answer is within 20° of the truth, write it into the model's card, and print by cross-validation "
        "how often answers of which confidence are right. The whole rotation counts, also of mugs whose handle is "
        "hidden.",
        epilog="examples:\n  kfit calibrate --model mug.safetensors --views 200\n"
        "  kfit calibrate --model mug.safetensors --seed 0 --check",
    )
    parser.add_argument(
        "--model",
        type=str,
        required=True,
        metavar="FILE.safetensors",
        help="the model; its card gets the calibration",
    )
    parser.add_argument("--views", type=int, default=400, help="number of objects, one view each")
    parser.add_argument("--seed", type=int, default=7, help="chooses the objects and poses")
    parser.add_argument(
        "--meshes",
        type=list[str] | str,
        default=[],
        metavar="[PLACE,…]",
        help="meshes that training has not seen, instead of procedural objects, in the words of `kfit bench accuracy`",
    )
    parser.add_argument("--depth", action="store_true", help="calibrate fits to depth too")
    parser.add_argument("--check", action="store_true", help="try what the card holds on these views; write nothing")
    return parser


def run(args: Namespace) -> None:
    """Fit the views, calibrate or check, and print the table."""
    if not args.model.endswith(".safetensors"):
        raise ValueError(f"--model must name a .safetensors file, got {args.model}")
    if args.views < 2:
        raise ValueError(f"--views must be at least 2, got {args.views}")
    from kfit.bench.calibration_views import calibration_views
    from kfit.bench.covariance import pose_offsets, squared_mahalanobis
    from kfit.bench.held_out_views import RIGHT_DEG, answers, rotation_errors
    from kfit.data.mesh_places import find_mesh_files
    from kfit.models import load, write_model
    from kfit.pose.calibrating import CHI2_95, calibrate, cross_validated, reliability
    from kfit.pose.confidence import UNMEASURED, how_fitted

    model = load(args.model)
    kind = "RGB-D" if args.depth else "RGB"
    before = model.card.calibration.get(kind)
    if args.check and before is None:
        raise ValueError(f"--check: the card of {args.model} holds no calibration of {kind} fits")
    known = model.card.known
    if known.shapes is None and not args.meshes:
        raise ValueError(f"nothing draws objects of the category {known.name}; --meshes gives some")
    meshes = find_mesh_files(args.meshes, [known.name]) if args.meshes else []
    pipeline = model.pipeline(depth=args.depth)
    names: list[str] = []
    distances: list[float] = []
    features: list[dict[str, float]] = []
    right: list[bool] = []
    energy: list[float] = []
    fitted = None
    with progress() as bar:
        task = bar.add_task("drawing", total=args.views)

        def on_view(done: int) -> None:
            bar.update(task, completed=done)

        sets = list(calibration_views(model, args.views, args.seed, on_view, meshes))
        bar.reset(task, description="fitting")
        for chosen, views in sets:
            _, results = rotation_errors(model, views, pipeline)
            fitted = fitted or results[0]
            found_right: list[int] = []
            for answer in answers(model, views, results):
                names.append(chosen.name)
                features.append(answer.evidence)
                right.append(answer.error_deg < RIGHT_DEG and not chosen.foreign)
                found_right += [answer.number] if right[-1] else []
                energy += [] if chosen.foreign else [answer.energy]
            distances += squared_mahalanobis(*pose_offsets(model, views, results, found_right)).tolist()
            bar.advance(task, len(views.crops))
    if args.check and before is not None:
        probabilities = [before.probability(one) for one in features]
        print_reliability(reliability(probabilities, right), "the card's calibration")
        print_sets(by_set(names, probabilities, right))
        over = sum(one > before.energy_99 for one in energy) / len(energy)
        print(f"{100 * over:.0f} % of the category's views have an energy above the card's {before.energy_99:.3f}")
        inside = sum(one < CHI2_95 for one in distances)
        print(f"{inside} of {len(distances)} right answers have the truth in the 95 % ellipsoid of their covariance")
        return
    if fitted is None or not features:
        raise ValueError("no view could be fitted, so there is nothing to calibrate")
    # The distances under covariances without the factor that the card has had so far.
    factor = UNMEASURED if before is None else before.covariance_factor
    distances = [factor * distance for distance in distances]
    weights = {name: float(weight) for name, weight in pipeline.weights.items() if weight}  # type: ignore[arg-type]
    found = calibrate(features, right, energy, how_fitted(fitted, weights), args.seed, distances)
    found.measured["sets"] = by_set(names, cross_validated(features, right), right)
    card = replace(model.card, calibration={**model.card.calibration, kind: found})
    write_model(Path(args.model), model.networks, card)  # the weights that were measured, with their card
    print_reliability(found.measured, "by cross-validation")
    print_sets(found.measured["sets"])
    print(f"covariances are multiplied by {found.covariance_factor:.2f}, by {len(distances)} right answers")
    log.info("wrote the calibration into %s", args.model)


def by_set(names: Sequence[str], probabilities: Sequence[float], right: Sequence[bool]) -> dict[str, Any]:
    """Number of answers of each set, the share of right ones, and of those that are given 0.8 or more."""
    found: dict[str, Any] = {}
    for name in dict.fromkeys(names):
        rows = [(p, yes) for one, p, yes in zip(names, probabilities, right, strict=True) if one == name]
        high = [yes for p, yes in rows if p >= CONFIDENT]
        found[name] = {
            "number": len(rows),
            "right": sum(yes for _, yes in rows) / len(rows),
            "mean confidence": sum(p for p, _ in rows) / len(rows),
            "confident": len(high),
            "right of the confident": sum(high) / len(high) if high else None,
        }
    return found


def print_sets(found: dict[str, Any]) -> None:
    """Print what `by_set` found."""
    from rich.table import Table

    table = Table("views", "answers", "right", "mean confidence", f"confidence ≥ {CONFIDENT:g}", "right of these")
    for name, row in found.items():
        share = row["right of the confident"]
        table.add_row(
            name,
            str(row["number"]),
            f"{100 * row['right']:.0f} %",
            f"{100 * row['mean confidence']:.0f} %",
            str(row["confident"]),
            "–" if share is None else f"{100 * share:.0f} %",
        )
    table_console(100).print(table)


def print_reliability(found: dict[str, Any], how: str) -> None:
    """Print what `kfit.pose.calibrating.reliability` found."""
    from rich.table import Table

    table = Table("confidence", "answers", "on average", "within 20°", title=how)
    for row in found["bins"]:
        span = f"{100 * row['from']:.0f} to {100 * row['to']:.0f} %"
        table.add_row(span, str(row["number"]), f"{100 * row['predicted']:.0f} %", f"{100 * row['right']:.0f} %")
    table_console(100).print(table)
    print(
        f"{100 * found['right']:.0f} % of {sum(row['number'] for row in found['bins'])} are within 20°; calibration "
        f"error {100 * found['calibration error']:.1f} %; Brier score {found['brier']:.3f}, "
        f"{found['brier of the share']:.3f} if all had the share of right ones as confidence"
    )
