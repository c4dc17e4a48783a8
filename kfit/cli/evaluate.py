"""Score predictions as NOCS does.

Prints average precision by category and writes tables and curves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, progress, table_console

if TYPE_CHECKING:
    from rich.table import Table

    from kfit.metrics import NOCSScores
    from kfit.reports.precision_tables import PrecisionTable


def parser() -> ArgumentParser:
    """Arguments of ``kfit evaluate``."""
    parser = ArgumentParser(
        description="Score results_*.pkl as the public NOCS evaluators do: average precision of 3D boxes and of poses "
        "whose box was found, by category. Writes DIR/scores.md, scores.csv, scores.json and curves.png, and of "
        "several methods rotation.png, translation.png and iou.png too. Poses are scored as NOCS's evaluator "
        "does, which does not clip before its arc cosine: where rounding leaves the domain, at 0° and 180°, an error "
        "is NaN and passes every threshold, so that a pose that is exactly upside down can count as right. "
        "object-deformnet's evaluator clips, and its pose AP differs in such cases.",
        epilog="examples:\n  kfit evaluate results/ --out scores\n  kfit evaluate ours/ nocs/ --out comparison\n"
        "  kfit evaluate results.csv --bop ycbv --out scores",
    )
    parser.add_argument(
        "predictions",
        type=str,
        nargs="+",
        metavar="PREDICTIONS",
        help="folders of results_*.pkl, each a method named as the folder; or such files, which make one method",
    )
    parser.add_argument("--out", type=str, default="kfit_scores", help="folder to write to", metavar="DIR")
    parser.add_argument(
        "--iou",
        type=Literal["nocs", "axis_aligned", "oriented"],
        default="nocs",
        help="how boxes are compared: as published, by hulls along the camera's axes as the publication means, or "
        "exactly",
    )
    parser.add_argument(
        "--poses",
        type=str,
        default="pred_RTs",
        metavar="KEY",
        help="poses to evaluate; boxes still come from pred_RTs, as when the paper's code evaluates its pred_RTs_ours",
    )
    parser.add_argument(
        "--scale-agnostic",
        action="store_true",
        help="compare objects brought to one size, for methods that see colour alone; distances in diagonals d",
    )
    bop = parser.add_argument_group("results in BOP's format")
    bop.add_argument(
        "--bop",
        type=str,
        default=None,
        metavar="FOLDER",
        help="a data set in BOP's format: PREDICTIONS are then its .csv files of results, or folders of them, and what "
        "is printed is the recall of poses by object, symmetries of models_info.json counted",
    )
    bop.add_argument("--split", type=str, default="test", metavar="NAME", help="folder of its scenes")
    return parser


def run(args: Namespace) -> None:
    """Score, print, and write the files."""
    if args.bop is not None:
        from kfit.cli import bop_scores

        bop_scores.run(args)
        return
    if csv := [place for place in args.predictions if place.endswith(".csv")]:
        raise ValueError(f"{csv[0]} holds results in BOP's format; name the data set by --bop FOLDER")
    if args.scale_agnostic and args.poses != "pred_RTs":
        raise ValueError("--scale-agnostic needs sizes that belong to the poses: leave --poses out")

    from kfit.data.nocs_results import read_results
    from kfit.metrics import evaluate_nocs, scale_agnostic
    from kfit.metrics.nocs_protocol import SHIFTS_CM
    from kfit.reports.precision_tables import COLUMNS, SCALE_AGNOSTIC_COLUMNS, table_of

    methods = _methods(args.predictions)
    scores = {}
    shifts: Sequence[float] = range(0, 101, 2) if args.scale_agnostic else SHIFTS_CM
    with progress() as bar:
        for name, files in methods.items():
            results: Iterable[Mapping[str, Any]] = read_results(bar.track(files, description=name))
            if args.scale_agnostic:
                results = map(scale_agnostic, results)
            scores[name] = evaluate_nocs(results, shifts=shifts, iou=args.iou, poses=args.poses)
    columns = SCALE_AGNOSTIC_COLUMNS if args.scale_agnostic else COLUMNS
    tables = {name: table_of(score, columns) for name, score in scores.items()}
    settings = {"iou": args.iou, "poses": args.poses, "scale_agnostic": args.scale_agnostic}
    for path in _write(Path(args.out), scores, tables, settings):
        log.info("wrote %s", path)
    for name, score in scores.items():
        table_console(120).print(_shown(name, tables[name]))
        absent = [category for category, count in zip(tables[name], score.num_truths, strict=False) if not count]
        if absent:
            print(f"{name}: no {', '.join(absent)} in the images; the published mean counts each as 0")
    print(_legend(settings))


def _methods(places: list[str]) -> dict[str, list[Path]]:
    """Result files by the method's name."""
    from kfit.data.nocs_results import result_files

    methods: dict[str, list[Path]] = {}
    loose = sorted(file for place in places if not Path(place).is_dir() for file in result_files(place))
    if loose:
        methods[loose[0].resolve().parent.name] = loose
    for place in places:
        if Path(place).is_dir():
            name = Path(place).resolve().name
            methods[name if name not in methods else place] = result_files(place)
    return methods


def _shown(name: str, rows: PrecisionTable) -> Table:
    from rich.table import Table

    from kfit.reports.precision_tables import spelled

    table = Table("category", title=name, padding=0)
    for column in rows["mean"]:
        table.add_column(column, justify="right")
    for category, row in rows.items():
        table.add_row(category, *map(spelled, row.values()), end_section=category == "mug")
    return table


def _legend(settings: Mapping[str, Any]) -> str:
    boxes = {
        "nocs": "as the public NOCS evaluators compare them (see kfit.metrics.nocs_iou)",
        "axis_aligned": "by their hulls along the camera's axes",
        "oriented": "exactly",
    }[settings["iou"]]
    shifts = "; d is the diagonal of an object's box" if settings["scale_agnostic"] else ""
    compared = "" if settings["poses"] == "pred_RTs" else f" and are {settings['poses']}"
    return (
        f"Average precision in %. Boxes are compared {boxes}; poses are evaluated where the box was found at 3D IoU 0.1"
        f"{compared}; 10° and 60° are at any distance{shifts}."
    )


def _write(
    folder: Path, scores: dict[str, NOCSScores], tables: dict[str, PrecisionTable], settings: dict[str, Any]
) -> list[Path]:
    """Write tables and curves, all of them or none."""
    from kfit.reports import precision_tables
    from kfit.reports.precision_curves import curves_by_category, curves_by_method
    from kfit.runtime.atomic_write import atomic_write

    shift = "translation error [% of the diagonal]" if settings["scale_agnostic"] else "translation error [cm]"
    figures = {"curves.png": curves_by_category(scores, shift)}
    if len(scores) > 1:
        figures |= {f"{part}.png": curves_by_method(scores, part, shift) for part in ("rotation", "translation", "iou")}
    files = {
        "scores.md": precision_tables.as_markdown(tables, _legend(settings)).encode(),
        "scores.csv": precision_tables.as_csv(tables).encode(),
        "scores.json": precision_tables.as_json(scores, tables, settings).encode(),
    }
    writers: dict[str, Callable[[Path], object]] = {
        name: partial(Path.write_bytes, data=content) for name, content in files.items()
    }
    return atomic_write(folder, writers | {name: partial(drawn.savefig, dpi=150) for name, drawn in figures.items()})
