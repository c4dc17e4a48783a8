"""Find the poses in labelled photos: what is found, which way it points, and how well its box fits.

Nothing but the photos is given, as to `kfit pose PHOTO`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command
from kfit.bench.accuracy_page import Section
from kfit.bench.page import show, write_page
from kfit.runtime.console import log, progress

if TYPE_CHECKING:
    from kfit.bench.photo_labels import Label
    from kfit.pose import PoseResult

# An object is found if the box of its mask has this IoU with the drawn one; its 3D box is good from the second on.
FOUND, GOOD = 0.7, 0.75
CONFIDENT = 0.8


@dataclass(frozen=True)
class Row:
    """How one labelled object fared.

    Attributes:
        label: its label.
        mask_iou: IoU of the drawn box and the box of the best mask of the right category; 0 if there is none.
        box_iou: with the projected 3D box.
        faults: faults of the orientation; None where the object was not found.
        confidence: confidence of the answer.
    """

    label: Label
    mask_iou: float = 0.0
    box_iou: float = 0.0
    faults: tuple[str, ...] | None = None
    confidence: float = 0.0

    @property
    def found(self) -> bool:
        """With the right category, and where it is."""
        return self.mask_iou >= FOUND

    @property
    def right(self) -> bool:
        """Whether it is found, with the direction of the label."""
        return self.faults == ()


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench photos``."""
    parser = ArgumentParser(
        description="Find the poses of all objects in the photos of a folder, with nothing given but the photos, and "
        "compare them with FOLDER/labels.json: photos, each with objects of a category, a drawn box, and directions "
        "of the object's axes in the image, in degrees.",
        epilog="example:\n  kfit bench photos my_photos/",
    )
    parser.add_argument("folder", type=str, metavar="FOLDER", help="photos and labels.json")
    parser.add_argument("--out", type=str, default=None, metavar="DIR", help="write README.md there (default: nowhere)")
    return parser


def run(args: Namespace) -> None:
    """Measure, print the tables, and write them where they are wanted."""
    from kfit.bench.photo_labels import read_labels
    from kfit.models.find_poses import find_poses

    rows: list[Row] = []
    others = 0
    with progress() as bar:
        for path, labels in bar.track(read_labels(args.folder).items(), description="Photos"):
            try:
                results = find_poses(path)
            except (ValueError, OSError) as error:
                log.warning("%s", error)
                results = []
            scored = [score(label, results) for label in labels]
            others += len(results) - sum(row.mask_iou > 0 for row in scored)
            rows += scored
    tables = [objects(rows), totals(rows, others)]
    show(tables, 140)
    if args.out:
        write_page(args.out, "Photos", command("photos", args, parser().get_defaults()), tables)


def score(label: Label, results: Sequence[PoseResult]) -> Row:
    """The answer of the label's category whose mask fits best, compared with it."""
    import numpy as np

    from kfit.bench.photo_labels import box_iou, faults, overlap

    def corners(box: Sequence[float]) -> np.ndarray:
        return np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]], np.float64)

    drawn = corners(label.box)
    fits = [(overlap(corners(one.bbox_xywh), drawn), one) for one in results if one.category == label.category]
    best, answer = max(fits, key=lambda fit: fit[0], default=(0.0, None))
    if answer is None or best < 0.3:
        return Row(label)
    return Row(label, best, box_iou(label, answer), tuple(faults(label, answer)), answer.confidence)


def objects(rows: Sequence[Row]) -> Section:
    """A row an object."""
    return Section(
        "Objects",
        ["object", "category", "kind", "found, IoU", "orientation", "box, IoU", "confidence"],
        [
            [
                row.label.name,
                row.label.category,
                row.label.kind,
                f"{row.mask_iou:.2f}",
                "none" if row.faults is None else "; ".join(row.faults) or "right",
                f"{row.box_iou:.2f}",
                f"{100 * row.confidence:.0f} %",
            ]
            for row in rows
        ],
    )


def totals(rows: Sequence[Row], others: int) -> Section:
    """Shares of all objects, and of each category and kind."""
    groups: dict[str, list[Row]] = {"all": list(rows)}
    for row in sorted(rows, key=lambda row: row.label.category):
        groups.setdefault(row.label.category, []).append(row)
    for row in sorted(rows, key=lambda row: row.label.kind):
        groups.setdefault(row.label.kind, []).append(row)
    columns: dict[str, Callable[[Row], bool]] = {
        f"found, IoU ≥ {FOUND:g}": lambda row: row.found,
        "right orientation": lambda row: row.right,
        f"box IoU ≥ {GOOD:g}": lambda row: row.box_iou >= GOOD,
        f"wrong at ≥ {100 * CONFIDENT:.0f} %": lambda row: row.confidence >= CONFIDENT and not row.right,
    }
    return Section(
        "Totals",
        ["objects", "number", *columns],
        [[name, str(len(group)), *(_share(group, of) for of in columns.values())] for name, group in groups.items()],
        [
            "Right: every labelled direction and lean within the labeller's tolerance and 15°. Objects found that are "
            f"not labelled, or of another category than their label: {others}."
        ],
    )


def _share(rows: Sequence[Row], of: Callable[[Row], bool]) -> str:
    hits = sum(map(of, rows))
    return f"{hits} ({100 * hits / len(rows):.0f} %)"
