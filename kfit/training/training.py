"""What kfit's trainings share: how they are saved, compiled and stepped."""

from __future__ import annotations

import math
import warnings
from types import FrameType
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import nn

from kfit.devices import compile_networks


class Training(LightningModule):
    """A LightningModule whose checkpoints rebuild themselves and whose rate rises and falls.

    Attributes:
        rate: largest learning rate.
        weight_decay: of AdamW.
    """

    rate: float
    weight_decay: float = 0.0

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
        """Compile them, or say why not."""
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
