"""The fits of `kfit bench accuracy`: views of procedural objects and scans, objects of NOCS's frames, and sheets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from jsonargparse import Namespace
from rich.progress import Progress
from torch import from_numpy

from kfit.bench.calibration_views import covered
from kfit.bench.held_out_views import Corruption, HeldOutViews, answer_to, held_out_views
from kfit.bench.nocs_accuracy import fit_known, known_objects
from kfit.bench.pose_errors import measure
from kfit.bench.scans import find_scans, scan_views
from kfit.fitting.pipeline import FitPipeline
from kfit.geometry import CATEGORIES
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.card import KINDS
from kfit.reports.contact_sheet import SheetEntry, contact_sheet, evenly
from kfit.reports.lettering import Picture
from kfit.runtime.console import log

# Fits on a contact sheet, as many as a reader looks at.
NUM_SHOWN = 12
Figures = dict[str, dict[str, Any]]


@dataclass
class AccuracyFits:
    """Fits what was asked for, and keeps a sheet of fits for each category and source if they are wanted.

    Attributes:
        models: by category.
        bar: shows what is done.
        pipeline: the fit of a model, with depth or without.
        args: ``views`` and ``seed`` of procedural objects, ``meshes``, ``scan_views`` and ``nocs`` of others,
            ``views_of`` and ``hidden`` of both.
        depth: fit the views' depth too.
        shown: whether sheets are wanted.
        sheets: pictures by file name.
        views: views of categories and scans, by name, once they were drawn.
    """

    models: dict[str, CategoryModel]
    bar: Progress
    pipeline: Callable[[CategoryModel, bool], FitPipeline]
    args: Namespace
    depth: bool = False
    shown: bool = False
    sheets: dict[str, Picture] = field(default_factory=dict)
    views: dict[str, HeldOutViews] = field(default_factory=dict)

    def procedural(self) -> Figures:
        """Figures of each category on objects that kfit draws.

        Raises:
            ValueError: for a category whose objects nothing draws, if there is nothing else to measure on.
        """
        found: Figures = {}
        for category, model in self.models.items():
            if model.card.shapes is None:
                if not (self.args.meshes or self.args.nocs):
                    raise ValueError(f"nothing draws objects of the category {category}; --meshes gives some")
                continue
            task = self.bar.add_task(f"{category}, procedural", total=self.args.views)
            if category not in self.views:
                self.bar.update(task, description=f"{category}, drawing")
                shown = partial(self._show, task)
                self.views[category] = held_out_views(
                    model,
                    self.args.views,
                    self.args.seed,
                    on_view=shown,
                    kind=self.args.views_of,
                    corruption=self._corruption,
                )
                self.bar.reset(task, description=f"{category}, procedural")
            found[category] = self._measured(model, self.views[category], task, f"{category} procedural")
        return found

    def scans(self) -> Figures:
        """Figures of each scan of the categories."""
        scans, unknown = find_scans(self.args.meshes, self.models if self.args.model else CATEGORIES)
        for path in unknown:
            log.warning("left out: no folder of %s names a category; pass CATEGORY=%s", path, path.parent)
        found: Figures = {}
        for scan in scans:
            model = self.models.get(str(scan.category))
            if model is None:
                continue
            name = f"{scan.category}: {scan.name}"
            task = self.bar.add_task(name, total=self.args.scan_views)
            if name not in self.views:
                self.views[name] = scan_views(
                    model, scan, self.args.scan_views, self.args.seed, self.args.views_of, self._corruption
                )
            found[name] = self._measured(model, self.views[name], task, f"{scan.category} scan {scan.name}")
        return found

    @property
    def _corruption(self) -> Corruption | None:
        return partial(covered, share=self.args.hidden) if self.args.hidden else None

    def _show(self, task: Any, done: int) -> None:
        self.bar.update(task, completed=done)

    def _measured(self, model: CategoryModel, views: HeldOutViews, task: Any, sheet: str) -> dict[str, Any]:
        pipeline = self.pipeline(model, self.depth)
        done = measure(model, views, pipeline, partial(self._show, task))
        if self.shown:
            entries = [
                _entry(
                    answer_to(model, views, done.results, row),
                    views.photos[row],
                    f"{float(done.rotation_deg[row]):.1f}°, {float(done.translation_cm[row]):.1f} cm"
                    + ("" if views.visible[row] else ", handle hidden"),
                )
                for row in evenly(done.rotation_deg.tolist(), NUM_SHOWN)
            ]
            self._keep(sheet, entries, len(done.rotation_deg))
        return done.figures()

    def objects(self, ways: Sequence[str] = KINDS) -> list[dict[str, Any]]:
        """Errors of each object of the categories in NOCS's frames, fitted in these ways; None where it was not."""
        things = list(known_objects(self.args.nocs, self.models))
        task = self.bar.add_task("NOCS's frames", total=len(ways) * len(things))
        found: list[dict[str, Any]] = []
        shown: dict[str, list[tuple[float, SheetEntry]]] = {}
        for category, model in self.models.items():
            mine = [thing for thing in things if thing.thing.category == category]
            pipelines = {
                way: self.pipeline(model, way == "RGB-D")
                for way in ways
                if mine and (way == "RGB" or "depth" in model.drawn)
            }
            for known in mine:
                row: dict[str, Any] = {"name": known.name, "split": known.split, "category": category}
                row |= dict.fromkeys(KINDS)
                for way, pipeline in pipelines.items():
                    fit = fit_known(model, known, pipeline, way == "RGB-D")
                    row[way] = None if fit is None else {"rotation_deg": fit[1], "translation_cm": fit[2]}
                    if fit is not None and self.shown:
                        caption = f"{known.name}, {way}: {fit[1]:.1f}°, {fit[2]:.1f} cm"
                        entry = _entry(fit[0], known.frame.image / 255, caption)
                        shown.setdefault(f"{category} {known.split}", []).append((fit[1], entry))
                    self.bar.advance(task)
                found.append(row)
        for sheet, rows in shown.items():
            self._keep(sheet, [rows[row][1] for row in evenly([error for error, _ in rows], NUM_SHOWN)], len(rows))
        return found

    def _keep(self, sheet: str, entries: list[SheetEntry], number: int) -> None:
        if entries:
            title = f"{sheet}: {len(entries)} of {number} fits, from the best to the worst"
            self.sheets[f"{sheet.replace(' ', '_')}.png"] = contact_sheet(entries, title)


def _entry(answer: PoseResult, photo: Any, caption: str) -> SheetEntry:
    """A fit on a sheet, from a photo (H, W, 3) in [0, 1]."""
    return SheetEntry(
        photo,
        answer.mask,
        answer.crop,
        answer.drawing,
        from_numpy(answer.rotation),
        from_numpy(answer.translation),
        from_numpy(answer.size),
        from_numpy(answer.intrinsics),
        caption,
    )
