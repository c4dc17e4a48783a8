"""How fast a data set is fitted, read from disk and written to it."""

from __future__ import annotations

import json
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command
from kfit.bench.accuracy_page import Section
from kfit.bench.page import lightning_silent, show, write_page
from kfit.runtime.console import progress

if TYPE_CHECKING:
    from kfit.bench.held_out_views import HeldOutViews
    from kfit.pose import CategoryModel

REAL275 = 15_573  # objects that NOCS's detections hold in its 2,754 test frames
SHAPE, PHOTO = (480, 640), 160


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench dataset``."""
    parser = ArgumentParser(
        description="Draw photos of unseen objects, 640 × 480 with one object each, and fit the folder as `lightning "
        "predict -c recipes/fit_dataset.yaml` does: read, cut out, fit, evaluate, write. The first batch warms up and "
        "is counted apart.",
        epilog="example:\n  kfit bench dataset --device cuda --objects 1152 --batch-size 128 --out dataset",
    )
    parser.add_argument("--category", type=str, default="laptop", help="the bundled model")
    parser.add_argument("--objects", type=int, default=24, help="photos")
    parser.add_argument("--batch-size", type=int, default=1, help="photos at once")
    parser.add_argument("--device", type=str, default="cpu", help="cpu, cuda or whatever PyTorch calls it")
    parser.add_argument(
        "--precisions",
        type=list[str],
        default=["32-true", "bf16-mixed"],
        metavar="[NAME,…]",
        help="of the trainer, one after the other",
    )
    parser.add_argument("--seed", type=int, default=0, help="chooses objects, poses and starts")
    parser.add_argument("--out", type=str, default=None, metavar="DIR", help="write README.md there (default: nowhere)")
    return parser


def run(args: Namespace) -> None:
    """Draw, fit, print the table, and write it where it is wanted."""
    if args.batch_size < 1 or args.objects <= args.batch_size:
        raise ValueError(
            f"--objects must be more than one batch of at least 1, got {args.objects} of --batch-size {args.batch_size}"
        )
    from kfit.bench.held_out_views import held_out_views
    from kfit.models import load
    from kfit.runtime.devices import device_of

    device, model = device_of(args.device), load(args.category)
    rows = []
    with tempfile.TemporaryDirectory() as folder, progress() as bar:
        task = bar.add_task("drawing photos", total=args.objects)
        shown = partial(bar.advance, task)
        views = held_out_views(model, args.objects, args.seed, PHOTO, on_view=lambda done: shown())
        photos = Path(folder) / "photos"
        write_photos(views, photos)
        for precision in args.precisions:
            out = Path(folder) / precision
            bar.reset(task, description=f"fitting by {precision}")
            ends = fitted(photos, out, args, precision, device.type, lambda: shown(args.batch_size))
            rows.append([precision, *figures(ends, args), *accuracy_cells(model, views, out)])
    table = section(rows)
    show([table], 140)
    if args.out:
        write_page(
            args.out, "How fast a data set is fitted", command("dataset", args, parser().get_defaults()), [table]
        )


def write_photos(views: HeldOutViews, folder: Path) -> None:
    """Each view in the middle of a grey photo, with its mask."""
    import numpy as np
    from skimage.io import imsave

    folder.mkdir()
    top, left = ((whole - PHOTO) // 2 for whole in SHAPE)
    there = (slice(top, top + PHOTO), slice(left, left + PHOTO))
    for number, (drawn, covered) in enumerate(zip(views.photos, views.masks, strict=True)):
        photo, mask = np.full((*SHAPE, 3), 0.7, np.float32), np.zeros(SHAPE, np.float32)
        photo[there] = drawn - (1 - covered[..., None]) * 0.3
        mask[there] = covered
        for name, picture in ((f"{number:05}", photo), (f"{number:05}_mask", mask)):
            imsave(folder / f"{name}.png", (picture.clip(0, 1) * 255 + 0.5).astype(np.uint8), check_contrast=False)


def fitted(
    photos: Path, out: Path, args: Namespace, precision: Any, accelerator: str, on_batch: Callable[[], None]
) -> list[float]:
    """Fit the folder, telling of each batch, and the seconds until the end of each."""
    import torch
    from lightning import LightningModule, Trainer
    from lightning.pytorch import Callback

    from kfit.batch.dataset_fit import DatasetFit
    from kfit.batch.photo_folder import PhotoFolder

    class Watch(Callback):
        """Notes the time at each batch's end."""

        def on_predict_batch_end(self, trainer: Trainer, pl_module: LightningModule, *more: Any) -> None:
            ends.append(time.perf_counter() - begun)
            on_batch()

    ends: list[float] = []
    warnings.filterwarnings("ignore", message=".*LeafSpec.*")
    with lightning_silent(), torch.random.fork_rng():
        trainer = Trainer(
            accelerator={"cuda": "gpu"}.get(accelerator, accelerator), devices=1, precision=precision, logger=False,
            enable_checkpointing=False, enable_model_summary=False, enable_progress_bar=False,
            callbacks=[Watch()], default_root_dir=out,
        )  # fmt: skip
        data = PhotoFolder(photos, args.category, args.batch_size)
        begun = time.perf_counter()
        trainer.predict(DatasetFit(out, seed=args.seed), datamodule=data, return_predictions=False)
    return ends


def figures(ends: list[float], args: Namespace) -> list[str]:
    """The first batch's seconds, the rate of the others, and how long as many objects as REAL275's would take."""
    rate = (args.objects - args.batch_size) / (ends[-1] - ends[0])
    whole = ends[0] + (REAL275 - args.batch_size) / rate
    return [f"{ends[0]:.1f}", f"{rate:.2f}", f"{1000 / rate:.1f}", f"{whole / 60:.1f}"]


def accuracy_cells(model: CategoryModel, views: HeldOutViews, out: Path) -> list[str]:
    """Median rotation error, and the share of answers within 10°."""
    import torch

    from kfit.geometry import rotation_error, to_opencv

    found = torch.tensor(
        [json.loads((out / f"{number:05}.json").read_text())["rotation"] for number in range(len(views.photos))],
        dtype=torch.float64,
    )
    truth = to_opencv(views.rotation)
    full, by_axis = (rotation_error(found, truth, how) for how in (model.card.known.symmetry, "y"))
    away = torch.where(views.visible, full, by_axis).rad2deg()
    return [f"{float(away.median()):.1f}°", f"{100 * float((away < 10).double().mean()):.0f} %"]


def section(rows: list[list[str]]) -> Section:
    """A row for each precision."""
    header = [
        "precision", "first batch, s", "objects a second", "ms an object", f"{REAL275:,} objects, min",
        "rotation error", "< 10°",
    ]  # fmt: skip
    notes = [
        "From the files to the files, photos and masks being PNGs; REAL275's objects are as many as "
        "NOCS's detections hold, extrapolated."
    ]
    return Section("Whole data sets", header, rows, notes)
