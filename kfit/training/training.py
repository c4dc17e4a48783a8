"""Base class of kfit's trainings: checkpoints, compilation, schedule and evaluation."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from types import FrameType
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn
from torchmetrics import CatMetric

from kfit.core.seeds import mixed_seed
from kfit.geometry import Symmetry
from kfit.metrics import rotation_error_deg, summary
from kfit.runtime.devices import compile_networks


class Training(LightningModule):
    """A LightningModule whose checkpoints rebuild themselves, whose rate rises and falls, and that is judged by the
    same measures in validation and in test.

    Where `report` calls `record_rotations`, the median error is logged as ``val/rotation_deg`` or
    ``test/rotation_deg``, and the shares of them under 10° and 30°, which are average precisions as the paper counts
    them, as ``…/within_10deg`` and ``…/within_30deg``: those of all processes together.

    Attributes:
        rate: largest learning rate.
        weight_decay: of AdamW.
    """

    rate: float
    weight_decay: float = 0.0

    def __init__(self) -> None:
        super().__init__()
        # In degrees; a fit that failed counts as 180. In a tuple, or it would stand among the networks that Lightning
        # lists.
        self._errors = (CatMetric(nan_strategy=180.0),)

    def on_train_start(self) -> None:
        self._seed = torch.initial_seed()

    def on_train_batch_start(self, batch: Any, batch_idx: int) -> None:
        # Each step has its own random numbers, so that a training that goes on from a checkpoint draws what it would
        # have drawn.
        step = f"process {self.global_rank}, batch {batch_idx}"
        torch.manual_seed(mixed_seed(self._seed, self.current_epoch, step))

    @abstractmethod
    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log metrics on held-out views, under names that begin with the stage: val or test."""

    def validation_step(self, batch: dict[str, Tensor], batch_idx: int) -> None:
        self.report(batch, "val")

    def test_step(self, batch: dict[str, Tensor], batch_idx: int) -> None:
        self.report(batch, "test")

    def on_validation_epoch_end(self) -> None:
        self._report_rotations("val")

    def on_test_epoch_end(self) -> None:
        self._report_rotations("test")

    def record_rotations(self, found: Tensor, truth: Tensor, symmetry: Symmetry) -> None:
        """Record the errors of rotations (N, 3, 3) against the truth (N, 3, 3); the epoch's end logs them.

        Objects of symmetry ``"y"`` count by the angle between their axes.
        """
        # Autocast leaves doubles alone; its halves would be half a degree wide.
        errors = rotation_error_deg(found.double().cpu(), truth.double().cpu(), symmetry)
        self._errors[0].update(errors.float().to(self.device))

    def _report_rotations(self, stage: str) -> None:
        (errors,) = self._errors
        if not errors.update_called:
            return
        found = summary(torch.as_tensor(errors.compute()).flatten())
        errors.reset()
        self.log(f"{stage}/rotation_deg", found["median"], prog_bar=True, sync_dist=True)
        for limit in (10, 30):
            self.log(f"{stage}/within_{limit}deg", found[f"under_{limit}"], sync_dist=True)

    def remember(self, frame: FrameType | None) -> None:
        """Keep the arguments of the constructor whose frame this is for the checkpoint, as plain data.

        From a recipe networks come as words and are kept. Built by hand they come as modules, for which Lightning
        warns: they are left out, also of what it shows to loggers.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.save_hyperparameters(frame=frame)
        left = [name for name, value in self.hparams.items() if not _is_plain(value)]
        self.save_hyperparameters(ignore=left, frame=frame)

    def compile_networks(self, *networks: nn.Module) -> None:
        """Compile them, or log why not."""
        if not compile_networks(*networks):
            self.print("no C++ compiler found: training goes on uncompiled")

    def configure_optimizers(self) -> Any:
        """AdamW whose rate rises over the first twentieth of the steps and falls as a cosine.

        Raises:
            ValueError: for a trainer without an end.
        """
        trained = [parameter for parameter in self.parameters() if parameter.requires_grad]
        optimizer = torch.optim.AdamW(trained, lr=self.rate, weight_decay=self.weight_decay)
        total = self.trainer.estimated_stepping_batches
        if total == math.inf:
            raise ValueError("the trainer needs max_epochs or max_steps: the rate falls towards the end of training")
        # Not OneCycleLR: that keeps its end in the checkpoint, so a run could not be resumed for more epochs.
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _share(step, int(total)))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def _share(step: int, total: int) -> float:
    """Share of the largest rate: up over the first twentieth of the steps, then down as a cosine."""
    rise = max(1, total // 20)
    if step < rise:
        return (step + 1) / (rise + 1)
    return (1 + math.cos(math.pi * min(1.0, (step - rise) / max(1, total - rise)))) / 2


def _is_plain(value: Any) -> bool:
    """Whether a hyperparameter is made of numbers, strings and the like alone, so that a checkpoint may hold it."""
    if isinstance(value, dict):
        return all(_is_plain(item) for item in value.values())
    return value is None or isinstance(value, str | int | float | list | tuple)
