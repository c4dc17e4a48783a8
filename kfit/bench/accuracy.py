"""Rotation and translation errors of models on unseen procedural objects, on scans, and on NOCS's frames."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy_page import circumstances, mean_of, objects_section, page, views_section
from kfit.runtime.console import log, progress, table_console

if TYPE_CHECKING:
    from kfit.bench.accuracy_fits import Figures
    from kfit.fitting.pipeline import FitPipeline
    from kfit.pose import CategoryModel
    from kfit.reports.lettering import Picture


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench accuracy``."""
    parser = ArgumentParser(
        description="Fit views of procedural objects whose seeds, shape families and texture families were held out of "
        "training, views of scanned objects, and objects of NOCS's frames by their true masks, and print median "
        "rotation errors and the shares under 5°, 10°, 30° and 60°. Symmetric classes, and mugs whose handle is hidden "
        "(less than 2 % of the mask), are measured by their axis, as NOCS does; mugs also on the views that show it.",
        epilog="examples:\n  kfit bench accuracy --categories '[mug]' --views 20\n"
        "  kfit bench accuracy --meshes '[scans@z,bottle=scans/shampoo@-y]' --nocs nocs --out accuracy",
    )
    add_sources(parser, 100)
    fit = parser.add_argument_group("fits")
    fit.add_argument("--starts", type=int, default=4, help="starts a view, best of 4 times as many; 16 if headless")
    fit.add_argument("--steps", type=int, default=16, help="steps of the optimizer")
    fit.add_argument("--depth", action="store_true", help="fit the views' depth too, as `kfit pose --depth` does")
    fit.add_argument("--prune", type=bool, default=True, help="drop unlikely starts on the way, as `kfit pose` does")
    output = parser.add_argument_group("output")
    output.add_argument("--card", action="store_true", help="write the figures into the card of --model")
    output.add_argument(
        "--out",
        type=str,
        default=None,
        metavar="DIR",
        help="write README.md, accuracy.json and sheets of fits there (default: nowhere)",
    )
    return parser


def add_sources(parser: ArgumentParser, views: int) -> None:
    """Add the arguments that choose models and what they are measured on, ``views`` procedural objects by default."""
    models = parser.add_argument_group("models")
    models.add_argument(
        "--categories", type=list[str], default=None, metavar="[NAME,…]", help="bundled models (default: all of them)"
    )
    models.add_argument(
        "--model", type=str, default=None, metavar="FILE.safetensors", help="a model of your own, instead"
    )
    group = parser.add_argument_group("what they are measured on")
    group.add_argument("--views", type=int, default=views, help="procedural objects a category, a view each; 0: none")
    group.add_argument(
        "--views-of",
        type=Literal["upright", "table", "any"],
        default="upright",
        help="how objects and scans are seen: upright in the middle of the picture, hand-held before a table (off the "
        "middle, rolled, 0.4 to 1.2 m away, known intrinsics), or from anywhere (all rotations)",
    )
    group.add_argument(
        "--hidden",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="hide this share of each object behind a square, which its mask leaves out",
    )
    group.add_argument(
        "--meshes",
        type=list[str] | str,
        default=[],
        metavar="[PLACE,…]",
        help="meshes: folders with the category as a word in the name (025_mug), or CATEGORY=FOLDER; y is up and the "
        "front (handle, lens, screen) at +x, or what stands behind: FOLDER@UP or FOLDER@UP,FRONT (@z, @y,-z, …)",
    )
    group.add_argument("--scan-views", type=int, default=50, help="views of each scan")
    group.add_argument("--nocs", type=str, default=None, metavar="FOLDER", help="frames in the folders of NOCS's data")
    group.add_argument("--seed", type=int, default=0, help="chooses the objects, poses and lights of the views")


def check_sources(args: Namespace) -> None:
    """Refuse sources that leave nothing to measure, and numbers out of range.

    Raises:
        ValueError: for these.
    """
    for name, least in {"views": 0, "scan_views": 1, "starts": 1, "steps": 0}.items():
        if args[name] < least:
            raise ValueError(f"--{name.replace('_', '-')} must be at least {least}, got {args[name]}")
    if not (args.views or args.meshes or args.nocs):
        raise ValueError("--views 0 leaves nothing to measure without --meshes or --nocs")


def models_of(args: Namespace) -> dict[str, CategoryModel]:
    """Return the models of ``--categories`` or ``--model`` by category.

    Raises:
        ValueError: for both options at once, and for no category.
    """
    if args.categories is not None and args.model is not None:
        raise ValueError("choose what to measure: --categories [NAME,…] or --model FILE.safetensors, not both")
    from kfit.models import bundled, load

    chosen = [args.model] if args.model else bundled() if args.categories is None else args.categories
    if not chosen:
        raise ValueError("--categories must name at least one bundled model, got none")
    return {model.card.category: model for model in map(load, chosen)}


def run(args: Namespace) -> None:
    """Run the requested measurements, print the tables, and write them if requested."""
    if args.card and args.model is None:
        raise ValueError("--card needs --model FILE.safetensors, whose card is written to")
    check_sources(args)
    if not 0 <= args.hidden < 1:
        raise ValueError(f"--hidden must be a share of at least 0 and below 1, got {args.hidden:g}")

    from kfit.bench.accuracy_fits import AccuracyFits
    from kfit.runtime.atomic_write import atomic_write

    models = models_of(args)
    flat = [category for category, model in models.items() if args.depth and "depth" not in model.drawn]
    if flat:
        raise ValueError(f"--depth needs models that draw depth; of {', '.join(flat)} it is the picture alone")
    with progress() as bar:
        fits = AccuracyFits(models, bar, partial(_pipeline, args), args, args.depth, shown=bool(args.out))
        procedural = fits.procedural() if args.views else {}
        scans = fits.scans() if args.meshes else {}
        objects = fits.objects() if args.nocs else []
    kind = _kind(args)
    sections = []
    if procedural:
        sections.append(views_section(f"Unseen procedural objects{kind}", procedural))
    if scans:
        sections.append(views_section(f"Scans{kind}", scans))
    if objects:
        sections.append(objects_section(objects))
    for section in sections:
        table_console(110).print(section.table())
        print("\n".join(section.notes))
    if args.card:
        write_card(models, args, procedural, scans, objects)
    if args.out:
        how = circumstances(command("accuracy", args, parser().get_defaults()), _schedule(args))
        results = {"procedural": procedural, "scans": scans, "objects": objects}
        means = {
            f"mean of {what}": mean_of(found) for what, found in (("procedural", procedural), ("scans", scans)) if found
        }
        texts = {"README.md": page(sections, how, sorted(fits.sheets)), "accuracy.json": _json(how | results | means)}
        writers: dict[str, Callable[[Path], object]] = {
            **{name: partial(write_text, text=text) for name, text in texts.items()},
            **{name: partial(_write_picture, picture=picture) for name, picture in fits.sheets.items()},
        }
        for path in atomic_write(Path(args.out), writers):
            log.info("wrote %s", path)


def _kind(args: Namespace) -> str:
    """The kind of views, as tables and cards name it."""
    hidden = f", {100 * args.hidden:g} % hidden" if args.hidden else ""
    return f", {args.views_of} views{hidden}" + (", with depth" if args.depth else "")


def _pipeline(args: Namespace, model: CategoryModel, depth: bool) -> FitPipeline:
    return model.pipeline(args.starts, args.steps, None if args.prune else (), depth)


def write_card(
    models: dict[str, CategoryModel], args: Namespace, procedural: Figures, scans: Figures, objects: list[Any]
) -> None:
    """Write the one model's file again, with what was measured in its card."""
    from kfit.models import write_model

    (model,) = models.values()
    schedule = {name: _schedule(args)[name] for name in ("starts", "steps", "pruned", "seed")}
    kind = _kind(args)
    measured: dict[str, Any] = {}
    for found in procedural.values():
        measured[f"unseen procedural objects, held-out families{kind}"] = {**schedule, **found}
    if scans:
        measured[f"scans{kind}"] = {**schedule, **scans}
    if objects:
        measured["objects of NOCS's frames, true masks"] = {**schedule, "objects": objects}
    card = replace(model.card, accuracy={**model.card.accuracy, **measured})
    write_model(Path(args.model), model.networks, card)  # the weights that were measured, with their card
    log.info("wrote the figures into %s", args.model)


def _schedule(args: Namespace) -> dict[str, Any]:
    return {
        "starts": args.starts,
        "steps": args.steps,
        "pruned": args.prune,
        "seed": args.seed,
        "views a category": args.views,
        "views of": args.views_of,
        "hidden": args.hidden,
        "views a scan": args.scan_views,
        "depth": args.depth,
    }


def _json(results: Any) -> str:
    """Strict JSON, in which what is not a number is null."""

    def clean(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: clean(value) for key, value in part.items()}
        if isinstance(part, list):
            return [clean(value) for value in part]
        return None if isinstance(part, float) and not math.isfinite(part) else part

    return json.dumps(clean(results), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_text(path: Path, text: str) -> None:
    """Write UTF-8."""
    path.write_text(text, encoding="utf-8")


def _write_picture(path: Path, picture: Picture) -> None:
    import cv2

    if not cv2.imwrite(str(path), picture[..., ::-1]):
        raise OSError(f"cannot write {path}")


def command(name: str, args: Namespace, defaults: Namespace) -> str:
    """The command line that repeats a benchmark, with what differs from the defaults."""
    words = ["kfit", "bench", name]
    for option, value in args.items():
        if option in ("out", "card") or option not in defaults or value == defaults[option]:
            continue
        words.append(f"--{option.replace('_', '-')}")
        if isinstance(value, list):
            words.append(f"[{','.join(value)}]")
        elif value is not True or option == "prune":
            words.append(str(value))
    return shlex.join(words)
