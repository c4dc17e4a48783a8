"""Training of the paper's baseline, which predicts rotations."""

from __future__ import annotations

import inspect

import torch
from lightning.pytorch.cli import LRSchedulerCallable, OptimizerCallable
from torch import Tensor

from kfit.baselines import OrientationRegressor
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.geometry import rotation_from_angles
from kfit.training.random_corruption import RandomCorruption
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.training import Training


class OrientationTraining(Training):
    """Train a regressor on views of many objects with their true rotations.

    L = mean_n (1 − cos θ_n), see `kfit.baselines.OrientationRegressor.distance`. Batches are those of
    `kfit.data.ViewsDataModule`; their sources and targets are both used.

    Args:
        regressor: the network.
        rate: largest learning rate of AdamW; it rises over the first twentieth of the steps and falls as a cosine.
        weight_decay: weight decay of AdamW.
        weights: path of VGG16's ImageNet weights to start from, see `kfit.baselines.OrientationRegressor.fill`; None
            for random weights.
        corruption: random occlusion, brightness and shift; None for none.
        similarity: random scale of views before that. Views are assumed to be upright, so its ``roll_deg`` should be 0.
        compile: compile the regressor (`torch.compile`). Without a C++ compiler training goes on uncompiled.
        optimizer, scheduler: as in ``kfit.training.training.Training``; ``rate`` and ``weight_decay`` are of its AdamW.

    Raises:
        ValueError: if the weights belong to another network and, when training starts, if the trainer has no end.
        FileNotFoundError: if there is no file of weights.
    """

    def __init__(
        self,
        regressor: OrientationRegressor,
        rate: float = 3e-4,
        weight_decay: float = 1e-2,
        weights: str | None = None,
        corruption: RandomCorruption | None = None,
        similarity: RandomSimilarity | None = None,
        compile: bool = False,
        optimizer: OptimizerCallable | None = None,
        scheduler: LRSchedulerCallable | None = None,
    ) -> None:
        super().__init__(optimizer, scheduler)
        check_arguments(OrientationTraining, locals(), rate=(check_positive,), weight_decay=(0,))
        self.remember(inspect.currentframe())
        if weights is not None:
            regressor.fill(weights)
        self.regressor, self.rate, self.weight_decay = regressor, rate, weight_decay
        self.corruption, self.similarity, self.compiles = corruption, similarity, compile

    def on_fit_start(self) -> None:
        if self.compiles:
            self.compile_networks(self.regressor)

    def forward(self, image: Tensor) -> Tensor:
        """Return the rotations (N, 3, 3) of pictures (N, 3, S, S)."""
        output: Tensor = self.regressor(image)
        return output

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        image, mask, azimuth, elevation = _views(batch)
        truth = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth))
        with torch.no_grad():
            if self.similarity is not None:
                # What comes in from outside is 1, which for the ground's share is right too.
                image, ground = self.similarity(torch.cat([image, 1 - mask], 1)).split([3, 1], 1)
                mask = 1 - ground
            if self.corruption is not None:
                image, _ = self.corruption(image, mask)
        loss = self.regressor.distance(self(image), truth).mean()
        self.log("train/rotation", loss.detach(), prog_bar=True)
        return loss

    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log the loss and the errors of rotations."""
        image, _, azimuth, elevation = _views(batch)
        truth = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth))
        output = self(image)
        loss = self.regressor.distance(output, truth).mean()
        self.log(f"{stage}/rotation", loss, batch_size=len(image), sync_dist=True)
        self.record_rotations(output, truth, self.regressor.symmetry)


def _views(batch: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pictures, masks, azimuths and elevations of a batch's sources and targets, one after the other."""
    image, mask = (torch.cat([batch[f"{view}{part}"] for view in ("source", "target")]) for part in ("", "_mask"))
    azimuth, elevation = (torch.cat([batch[f"source_{angle}"], batch[angle]]) for angle in ("azimuth", "elevation"))
    return image, mask, azimuth, elevation
