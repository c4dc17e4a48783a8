"""Run by test_disk.py: every kind of writing as there is more and more room, in one process that owns its mounts."""

from __future__ import annotations

import os
import pickle
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from small_disk import Disk, Try, _call, ended, own_mounts

if __name__ == "__main__":
    own_mounts()  # before any library starts a thread

import numpy as np
import torch
from skimage.io import imsave
from tiny_model import write_tiny

import kfit.models
import kfit.pose.targets
from kfit.bench import page as bench_page
from kfit.cli.main import main
from kfit.data import build, dump_pickle, pose_view
from kfit.data.rendered_views import build_views
from kfit.models import load
from kfit.pose import CategoryModel
from kfit.pose.object_finder import FoundObject, box_of
from kfit.runtime.console import session
from kfit.segmentation import Segment
from kfit.tracking import TrackedPose, Tracker

Command = Callable[[], object]
# In blocks: for what is done in a moment, and how much is made each time for what takes long.
ROOMS = (0, 1, 2, 5, 12, *(30 * 3**k for k in range(9)))
ROUNDS = {"views": 50, "training": 33, "data set": 3}


def write_results(folder: Path) -> None:
    """NOCS's results of an image: two objects, found as they are."""
    truth = np.tile(np.diag([0.2, 0.2, 0.2, 1.0]), (2, 1, 1))
    truth[:, 2, 3] = 1
    sizes, ids = np.full((2, 3), 0.6), np.array([1, 6])
    result = {"image_path": "data/real/test/scene_1/0000", "gt_class_ids": ids, "gt_RTs": truth, "gt_scales": sizes}
    result |= {"pred_class_ids": ids, "pred_RTs": truth, "pred_scales": sizes, "pred_scores": np.ones(2)}
    dump_pickle(folder / "results_test_scene_1_0000.pkl", result)


class Still(Tracker):
    """Finds in every frame what it found in the first."""

    def __call__(self, *observed: object) -> TrackedPose:  # type: ignore[override]
        return self.last


def as_command(work: Command) -> Command:
    def command() -> None:
        with session([]):
            work()

    return command


def commands(here: Path) -> dict[str, Command]:
    """What writes, by name; what takes long before it writes is shortened."""
    mesh, light = build("laptop", 7)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    model = load("laptop")
    result = replace(model.pose(view.image, mask=view.mask, pipeline=model.pipeline(2, 2)), notes=())
    CategoryModel.pose = lambda *args, **how: result  # type: ignore[method-assign]
    found = FoundObject("laptop", 0.9, box_of(view.mask), Segment(view.mask))
    kfit.pose.targets.find_targets = lambda *args: [found]  # type: ignore[assignment]
    kfit.tracking.Tracker = Still  # type: ignore[misc]
    whole = CategoryModel.pipeline
    CategoryModel.pipeline = lambda self, **how: whole(self, 3, 2, **how)  # type: ignore[method-assign,assignment]
    photo, frames = here / "photo.png", here / "frames"
    imsave(photo, (255 * view.image).round().astype(np.uint8), check_contrast=False)
    frames.mkdir()
    rng = np.random.default_rng(0)
    for number in range(12):
        imsave(frames / f"{number}.png", rng.integers(0, 255, (128, 128, 3), np.uint8), check_contrast=False)
    write_results(here / "ours")
    pose = ["pose", str(photo), "--category", "laptop", "--quiet"]

    def calibrate() -> None:
        if not Path("tiny.safetensors").exists():
            write_tiny(Path("tiny.safetensors"))
        main(["calibrate", "--model", "tiny.safetensors", "--views", "2"])

    return {
        "pose": lambda: main(pose),
        "page": lambda: main([*pose, "--report", "pages/page.html"]),
        "gif": lambda: main([*pose, "--animation", "fit.gif"]),
        "mp4": lambda: main([*pose, "--animation", "fit.mp4"]),
        "video": lambda: main(["video", str(frames), "--category", "laptop", "--mask", str(photo), "--quiet"]),
        "model": as_command(lambda: write_tiny(Path("models/tiny.safetensors"))),
        "calibrate": calibrate,
        "evaluate": lambda: main(["evaluate", str(here / "ours"), "--out", "scores"]),
        "bench": as_command(lambda: bench_page.write_page("page", "Title", "kfit bench", [], ["line"] * 9999)),
    }


def works(here: Path) -> dict[str, Command]:
    """What may take hours, by name: the same command goes on."""
    import lightning.pytorch as pl
    from nocs_lookalike import write_frames
    from test_kills import TRAINING

    from kfit.batch.dataset_fit import DatasetFit
    from kfit.batch.nocs_fit import NOCSFit
    from kfit.training import lightning_cli as lightning

    write_tiny(here / "mug.safetensors")
    write_frames(here / "nocs", [("mug", "mug"), ("mug",), ("mug", "mug", "mug"), (), ("mug",), ("mug", "mug")])
    logger = TRAINING.index("--trainer.logger")
    training = [*TRAINING[:logger], *TRAINING[logger + 2 :], "--data.cache_dir", str(here / "cache")]

    def train() -> None:
        warnings.simplefilter("ignore")
        newest = sorted(Path().rglob("last.ckpt"), key=lambda path: path.stat().st_mtime)[-1:]
        goes_on = ["--ckpt_path", str(newest[0])] if newest else []
        lightning.main(["--quiet", *training, "--trainer.default_root_dir", ".", *goes_on])

    def fit() -> None:
        warnings.simplefilter("ignore")
        module = DatasetFit(Path("out"), {"mug": here / "mug.safetensors"}, num_starts=2, num_steps=2)
        silent = dict.fromkeys(("logger", "enable_checkpointing", "enable_model_summary", "enable_progress_bar"), False)
        trainer = pl.Trainer(accelerator="cpu", devices=1, default_root_dir=here, **silent)  # type: ignore[arg-type]
        with session(["--quiet"]):
            trainer.predict(module, datamodule=NOCSFit(here / "nocs", "real_test"), return_predictions=False)

    return {
        "views": as_command(lambda: build_views("views.h5", "mug", 40, 2, image_size=24)),
        "training": train,
        "data set": fit,
    }


def tries(disk: Disk, command: Command) -> list[Try]:
    """On a disk with room, on one that is read-only, and with more and more room on one where the same was written
    before, until there is enough."""
    kept = [tried(disk, command)]
    for room in (None, *ROOMS):
        disk.leave(room)
        kept.append(tried(disk, command))
        if kept[-1].end.status != 2:
            break
    return kept


def rounds(disk: Disk, command: Command, room: int) -> list[Try]:
    """The work on a disk with room, and again on one where room is made each time that it is full."""
    kept = [tried(disk, command)]
    for path in disk.path.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for _ in range(30):
        disk.leave(room)
        kept.append(tried(disk, command))
        if kept[-1].end.status != 2:
            break
    return kept


def tried(disk: Disk, command: Command) -> Try:
    before = disk.files()
    return Try(ended(command), before, disk.files())


if __name__ == "__main__":
    torch.set_num_threads(1)
    out, names = Path(sys.argv[1]), sys.argv[2:]
    found: dict[str, list[Try]] = {}
    with tempfile.TemporaryDirectory() as folder:
        known = (works if names[0] in ROUNDS else commands)(Path(folder))
        for name in names:
            disk = Disk(Path(folder, f"disk of {name}"))
            disk.path.mkdir()
            disk.mount()
            os.chdir(disk.path)
            found[name] = rounds(disk, known[name], ROUNDS[name]) if name in ROUNDS else tries(disk, known[name])
            os.chdir("/")
            _call("umount2", str(disk.path).encode(), 2)  # also where a library has a file open yet
    out.write_bytes(pickle.dumps(found))
