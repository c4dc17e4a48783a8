"""A picture of the state of training: target, reconstruction and novel views, each epoch."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import CometLogger, Logger, MLFlowLogger
from numpy.typing import NDArray
from skimage.io import imsave
from torch import Tensor

from kfit.core.arguments import check_arguments

NAME = "pictures"  # in the log


class PictureGrid(Callback):
    """Log a grid of pictures after each validation, as ``pictures``.

    Each row is an object: the encoder's input, the target, its reconstruction, and views around it at 30° elevation.
    TensorBoard, Weights & Biases, MLflow and Comet accept pictures, like any logger with ``log_image`` (as the second)
    or with an ``experiment`` that has ``add_image`` (as the first). Without such a logger the grid is written to
    ``pictures/epoch_NNN.png`` in the run's folder.

    Args:
        num_objects: rows.
        num_views: novel views a row.
    """

    def __init__(self, num_objects: int = 8, num_views: int = 6) -> None:
        check_arguments(PictureGrid, locals())
        self.num_objects, self.num_views = num_objects, num_views
        self._shown: dict[str, Tensor] | None = None

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        if batch_idx == 0:
            # Rows from different objects: a batch holds the views of one object one after another.
            rows = torch.linspace(0, len(batch["target"]) - 1, min(self.num_objects, len(batch["target"]))).long()
            self._shown = {
                name: batch[name][rows.to(batch[name].device)] for name in ("source", "target", "azimuth", "elevation")
            }

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        home = trainer.log_dir  # every process must ask: they agree on it among themselves
        if self._shown is None or trainer.sanity_checking or not trainer.is_global_zero:
            return
        shown = self._shown
        with torch.no_grad():
            columns = [
                shown["source"],
                shown["target"],
                pl_module(shown["source"], shown["azimuth"], shown["elevation"]).image,
            ]
            tilt = torch.full_like(shown["elevation"], math.radians(30))
            for turn in range(self.num_views):
                azimuth = torch.full_like(tilt, 2 * math.pi * turn / self.num_views)
                columns.append(pl_module(shown["source"], azimuth, tilt).image)
        grid = torch.cat([torch.cat(list(row), 2) for row in zip(*columns, strict=True)], 1).clamp(0, 1)
        pixels = (grid * 255).round().byte().permute(1, 2, 0).cpu().numpy()
        shows = [_show(logger, pixels, trainer.global_step) for logger in trainer.loggers]
        if not any(shows) and home is not None:
            folder = Path(home) / "pictures"
            folder.mkdir(parents=True, exist_ok=True)
            imsave(folder / f"epoch_{trainer.current_epoch:03d}.png", pixels, check_contrast=False)


def _show(logger: Logger, pixels: NDArray[np.uint8], step: int) -> bool:
    """Log a picture (H, W, 3), and return whether the logger accepts pictures."""
    experiment: Any = getattr(logger, "experiment", None)
    if isinstance(logger, MLFlowLogger):
        experiment.log_image(logger.run_id, pixels, key=NAME, step=step)
    elif isinstance(logger, CometLogger):
        experiment.log_image(pixels, name=NAME, step=step)
    elif hasattr(logger, "log_image"):
        logger.log_image(key=NAME, images=[pixels], step=step)
    elif hasattr(experiment, "add_image"):
        experiment.add_image(NAME, pixels, step, dataformats="HWC")
    else:
        return False
    return True
