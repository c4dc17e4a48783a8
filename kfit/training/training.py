"""Base class of kfit's trainings: checkpoints, compilation, schedule and evaluation."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from types import FrameType
from typing import Any

import torch
from lightning.pytorch import LightningModule
from lightning.pytorch.cli import LRSchedulerCallable, OptimizerCallable, ReduceLROnPlateau
from torch import Tensor, nn
from torchmetrics import CatMetric

from kfit.core.seeds import mixed_seed
from kfit.geometry import Symmetry
from kfit.metrics import rotation_error_deg, summary
from kfit.runtime.devices import compile_networks


class Training(LightningModule):
    """Base of kfit's LightningModules: self-contained checkpoints, choice of the optimizer, and common metrics.

    Without an optimizer of its own it is trained by AdamW; without a scheduler, the rate rises over the first twentieth
    of the steps and falls as a cosine. In a recipe they are named as in any of Lightning's:
    ``optimizer: {class_path: torch.optim.SGD, init_args: {lr: 0.1}}``. A scheduler is stepped after each epoch.

    If `report` calls `record_rotations`, the median error is logged as ``val/rotation_deg`` or ``test/rotation_deg``,
    and the fractions of errors under 10° and 30°, which are average precisions as in the paper, as ``…/within_10deg``
    and ``…/within_30deg``, over all processes.

    Args:
        optimizer: function that builds the optimizer from the trained parameters.
        scheduler: function that builds the scheduler from that optimizer.

    Attributes:
        rate: largest learning rate of AdamW.
        weight_decay: weight decay of AdamW.
    """

    rate: float
    weight_decay: float = 0.0

    def __init__(
        self, optimizer: OptimizerCallable | None = None, scheduler: LRSchedulerCallable | None = None
    ) -> None:
        super().__init__()
        self.make_optimizer, self.make_scheduler = optimizer, scheduler
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
    def report(self, batch: Any, stage: str) -> None:
        """Log metrics on held-out views, under names that begin with the stage: val or test."""

    def validation_step(self, batch: Any, batch_idx: int) -> None:
        self.report(batch, "val")

    def test_step(self, batch: Any, batch_idx: int) -> None:
        self.report(batch, "test")

    def on_validation_epoch_end(self) -> None:
        self._report_rotations("val")

    def on_test_epoch_end(self) -> None:
        self._report_rotations("test")

    def record_rotations(self, found: Tensor, truth: Tensor, symmetry: Symmetry) -> None:
        """Record the errors of rotations (N, 3, 3), which are logged at the end of the epoch.

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
        """Store the arguments of the calling constructor in the checkpoint, as plain data.

        Networks from a recipe are plain data and are stored. Networks that were built in Python are modules, for which
        Lightning warns: they are omitted, also in loggers.
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
        """Return the given optimizer and scheduler, else AdamW and a rate that rises and falls.

        Raises:
            ValueError: for kfit's own schedule and a trainer without an end.
        """
        trained = [parameter for parameter in self.parameters() if parameter.requires_grad]
        if self.make_optimizer is not None:
            optimizer = self.make_optimizer(trained)
        else:
            optimizer = torch.optim.AdamW(trained, lr=self.rate, weight_decay=self.weight_decay)
        if self.make_scheduler is not None:
            scheduler = self.make_scheduler(optimizer)
            watched = {"monitor": scheduler.monitor} if isinstance(scheduler, ReduceLROnPlateau) else {}
            return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, **watched}}
        total = self.trainer.estimated_stepping_batches
        if total == math.inf:
            raise ValueError("the trainer needs max_epochs or max_steps: the rate falls towards the end of training")
        # Not OneCycleLR: that keeps its end in the checkpoint, so a run could not be resumed for more epochs.
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _share(step, int(total)))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def _share(step: int, total: int) -> float:
    """Return the fraction of the largest rate: rising over the first twentieth of the steps, then a cosine."""
    rise = max(1, total // 20)
    if step < rise:
        return (step + 1) / (rise + 1)
    return (1 + math.cos(math.pi * min(1.0, (step - rise) / max(1, total - rise)))) / 2


def _is_plain(value: Any) -> bool:
    """Return whether a hyperparameter consists of plain values only, so that a checkpoint can hold it."""
    if isinstance(value, dict):
        return all(_is_plain(item) for item in value.values())
    return value is None or isinstance(value, str | int | float | list | tuple)
