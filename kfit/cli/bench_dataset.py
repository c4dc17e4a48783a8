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

from kfit.cli.accuracy_page import Section
from kfit.cli.bench_accuracy import command
from kfit.cli.bench_page import lightning_silent, show, write_page
from kfit.cli.session import progress

if TYPE_CHECKING:
    from kfit.models import CategoryModel
    from kfit.models.accuracy import UnseenViews

REAL275 = 15_573  # objects that NOCS's detections hold in its 2,754 test frames
SHAPE, PHOTO = (480, 640), 160


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench dataset``."""
    parser = ArgumentParser(
        description="Draw photos of unseen objects, 640 × 480 with one object each, and fit the folder as `lightning "
        "predict -c recipes/fit_dataset.yaml` does: read, cut out, fit, judge, write. The first batch warms up and is "
        "counted apart.",
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


def run(said: Namespace) -> None:
    """Draw, fit, print the table, and write it where it is wanted."""
    if said.batch_size < 1 or said.objects <= said.batch_size:
        raise ValueError(
            f"--objects must be more than one batch of at least 1, got {said.objects} of --batch-size {said.batch_size}"
        )
    from kfit.devices import device_of
    from kfit.models import load
    from kfit.models.accuracy import unseen_views

    device, model = device_of(said.device), load(said.category)
    rows = []
    with tempfile.TemporaryDirectory() as folder, progress() as bar:
        task = bar.add_task("drawing photos", total=said.objects)
        shown = partial(bar.advance, task)
        views = unseen_views(model, said.objects, said.seed, PHOTO, on_view=lambda done: shown())
        photos = Path(folder) / "photos"
        write_photos(views, photos)
        for precision in said.precisions:
            out = Path(folder) / precision
            bar.reset(task, description=f"fitting by {precision}")
            ends = fitted(photos, out, said, precision, device.type, lambda: shown(said.batch_size))
            rows.append([precision, *figures(ends, said), *judged(model, views, out)])
    table = section(rows)
    show([table], 140)
    if said.out:
        write_page(
            said.out, "How fast a data set is fitted", command("dataset", said, parser().get_defaults()), [table]
        )


def write_photos(views: UnseenViews, folder: Path) -> None:
    """Each view in the middle of a grey photo, its mask beside it."""
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
    photos: Path, out: Path, said: Namespace, precision: Any, accelerator: str, on_batch: Callable[[], None]
) -> list[float]:
    """Fit the folder, telling of each batch, and the seconds until the end of each."""
    import torch
    from lightning import LightningModule, Trainer
    from lightning.pytorch import Callback

    from kfit.models.dataset_fit import DatasetFit
    from kfit.models.photo_folder import PhotoFolder

    class Watch(Callback):
        """Notes the time at each batch's end."""

        def on_predict_batch_end(self, trainer: Trainer, pl_module: LightningModule, *rest: Any) -> None:
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
        data = PhotoFolder(photos, said.category, said.batch_size)
        begun = time.perf_counter()
        trainer.predict(DatasetFit(out, seed=said.seed), datamodule=data, return_predictions=False)
    return ends


def figures(ends: list[float], said: Namespace) -> list[str]:
    """The first batch's seconds, the rate of the others, and how long as many objects as REAL275's would take."""
    rate = (said.objects - said.batch_size) / (ends[-1] - ends[0])
    whole = ends[0] + (REAL275 - said.batch_size) / rate
    return [f"{ends[0]:.1f}", f"{rate:.2f}", f"{1000 / rate:.1f}", f"{whole / 60:.1f}"]


def judged(model: CategoryModel, views: UnseenViews, out: Path) -> list[str]:
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
