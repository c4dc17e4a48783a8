"""The cost of a training step."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer

from kfit.core.arguments import check_arguments
from kfit.runtime.devices import Operations, matrix_rate, wait


class Stopwatch(Callback):
    """Measure the time of training steps and of the waits between them.

    Args:
        warm_up: number of initial steps that are ignored, at least 1, because the first compiles networks.

    Attributes:
        seconds: median duration of a step, in seconds.
        waited: from a step's end to the next one's beginning, the median: for data and callbacks.
        pairs: views a step.
        operations: floating point operations of a step's convolutions and products, forwards and backwards.
        precision: the trainer's precision.
        device: device that is used for training.
        machine: GFLOP a second of matrix products in it.
    """

    def __init__(self, warm_up: int = 5) -> None:
        check_arguments(Stopwatch, locals(), warm_up=(0,))
        self.warm_up = warm_up
        self.operations, self.pairs, self.machine, self.precision = 0, 0, 0.0, ""
        self._steps: list[float] = []
        self._waits: list[float] = []
        self._begun = self._ended = 0.0
        self.device = torch.device("cpu")

    @property
    def seconds(self) -> float:
        return median(self._steps[self.warm_up :])

    @property
    def waited(self) -> float:
        return median(self._waits[self.warm_up - 1 :])  # the one before the first step that counts, and later ones

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Count a step's operations, before anything is compiled, and the machine's rate."""
        data: Any = trainer.datamodule  # type: ignore[attr-defined]
        # The module is on the CPU as yet.
        batch = {name: value.cpu() for name, value in next(iter(data.train_dataloader())).items()}
        self.pairs = len(batch["source"])
        self.precision = str(trainer.precision)
        with torch.random.fork_rng(), Operations() as counted, _silent(pl_module):
            loss: Any = pl_module.training_step(batch, 0)
            loss.backward()
        pl_module.zero_grad()
        self.operations = counted.total
        self.device = trainer.strategy.root_device
        self.machine = matrix_rate(torch.bfloat16 if "bf16" in self.precision else torch.float32, self.device)

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        self._begun = time.perf_counter()
        if self._ended:
            self._waits.append(self._begun - self._ended)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        wait(self.device)
        self._ended = time.perf_counter()
        self._steps.append(self._ended - self._begun)


@contextmanager
def _silent(module: LightningModule) -> Iterator[None]:
    """Nothing is logged, which Lightning allows in training alone."""
    vars(module).update(log=lambda *args, **named: None, log_dict=lambda *args, **named: None)
    try:
        yield
    finally:
        del vars(module)["log"], vars(module)["log_dict"]
