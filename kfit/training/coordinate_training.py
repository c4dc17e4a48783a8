"""Training of a network that predicts object coordinates."""

from __future__ import annotations

import inspect

import torch
from lightning.pytorch.cli import LRSchedulerCallable, OptimizerCallable
from torch import Tensor

from kfit.baselines import CoordinateRegressor
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.data.rasterizer import DISTANCE
from kfit.geometry import UNIT_FRACTION, rotation_from_angles
from kfit.training.random_recolor import RandomRecolor
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.training import Training


class CoordinateTraining(Training):
    """Train a regressor on views of many objects with the object coordinates of their pixels.

    L = mean_n of `kfit.baselines.CoordinateRegressor.divergence`. Batches are those of `kfit.data.ViewsDataModule` with
    depth; their targets are used, whose coordinates follow from depth, pose and camera, see ``coordinates_of``.

    Args:
        regressor: the network.
        rate: largest learning rate of AdamW; it rises over the first twentieth of the steps and falls as a cosine.
        weight_decay: weight decay of AdamW.
        unit_fraction: fraction of the picture's width that a unit diagonal has in the views' camera; ``lightning``
            sets the category's.
        distance: distance of the views' camera in box diagonals, for batches without it.
        similarity: random rotation, shift and scale of views, with their coordinates; None for none.
        recoloring: augmentation of colours; None for none.
        compile: compile the regressor (`torch.compile`). Without a C++ compiler training goes on uncompiled.
        optimizer, scheduler: as in ``kfit.training.training.Training``; ``rate`` and ``weight_decay`` are of its AdamW.

    Raises:
        ValueError: in training, if a batch has no depth and, when it starts, if the trainer has no end.
    """

    def __init__(
        self,
        regressor: CoordinateRegressor,
        rate: float = 2e-3,
        weight_decay: float = 1e-3,
        unit_fraction: float = UNIT_FRACTION,
        distance: float = DISTANCE,
        similarity: RandomSimilarity | None = None,
        recoloring: RandomRecolor | None = None,
        compile: bool = False,
        optimizer: OptimizerCallable | None = None,
        scheduler: LRSchedulerCallable | None = None,
    ) -> None:
        super().__init__(optimizer, scheduler)
        check_arguments(
            CoordinateTraining,
            locals(),
            rate=(check_positive,),
            weight_decay=(0,),
            unit_fraction=(0.1, 10.0),
            distance=(1, 1e6),
        )
        self.remember(inspect.currentframe())
        self.regressor, self.rate, self.weight_decay = regressor, rate, weight_decay
        self.unit_fraction, self.distance = unit_fraction, distance
        self.similarity, self.recoloring, self.compiles = similarity, recoloring, compile

    def on_fit_start(self) -> None:
        if self.compiles:
            self.compile_networks(self.regressor)

    def forward(self, image: Tensor) -> Tensor:
        """Return logits (N, 3, B, S, S) of the coordinates in pictures (N, 3, S, S)."""
        output: Tensor = self.regressor(image)
        return output

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        with torch.no_grad():
            image, mask, truth = self._views(batch)
            image = image if self.recoloring is None else self.recoloring(image)
            if self.similarity is not None:
                # Pixels from outside are 1: the channel of the background is 1 there, and coordinates are 0.
                parts = torch.cat([image, 1 - mask, 1 + mask * truth], 1)
                image, ground, moved = self.similarity(parts).split([3, 1, 3], 1)
                mask = 1 - ground
                truth = (moved - 1) / mask.clamp_min(1e-3)
        loss = self.regressor.divergence(self(image), truth, mask).mean()
        self.log("train/coordinates", loss.detach(), prog_bar=True)
        return loss

    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log the loss."""
        image, mask, truth = self._views(batch)
        loss = self.regressor.divergence(self(image), truth, mask).mean()
        self.log(f"{stage}/coordinates", loss, prog_bar=True, batch_size=len(image), sync_dist=True)

    def _views(self, batch: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Return pictures, masks and true coordinates of a batch's targets."""
        if "target_depth" not in batch:
            raise ValueError("CoordinateTraining needs views with depth, and there is none in this data")
        mask = batch["target_mask"]
        angles = batch["azimuth"], batch["elevation"]
        distance = batch.get("distance", self.distance)
        truth = coordinates_of(batch["target_depth"], *angles, self.unit_fraction, distance) * (mask > 0)
        return batch["target"], mask, truth


def coordinates_of(
    depth: Tensor,
    azimuth: Tensor,
    elevation: Tensor,
    unit_fraction: float = UNIT_FRACTION,
    distance: Tensor | float = DISTANCE,
) -> Tensor:
    """Return the object coordinates of the points that the standard camera sees (`kfit.data.pose_view`).

    X = Rᵀ (x (d + D), y (d + D), −d) with R = Rx(elevation) · Ry(azimuth), pixel (u, v) of S × S on the ray (x, y, −1),
    x = (u − (S − 1) / 2) / f, y = ((S − 1) / 2 − v) / f, f = unit_fraction · S · √(D² − 1/4).

    Args:
        depth: d (N, 1, S, S) in box diagonals relative to the object's centre.
        azimuth, elevation: (N,) in radians.
        unit_fraction: share of the picture's width that a unit diagonal at the centre spans.
        distance: D of the camera from the centre, in box diagonals: one, or (N,) of them.

    Returns:
        (N, 3, S, S) in box diagonals, in the object's frame.
    """
    size = depth.shape[-1]
    # Out of autocast, whose halves would move points by a hundredth of the object.
    with torch.autocast(depth.device.type, enabled=False):
        distance = torch.as_tensor(distance, device=depth.device, dtype=depth.dtype).reshape(-1, 1, 1, 1)
        focal = unit_fraction * size * (distance.square() - 0.25).sqrt()
        along = (torch.arange(size, device=depth.device, dtype=depth.dtype) - (size - 1) / 2) / focal
        away = depth + distance
        points = torch.cat([along * away, -along.mT * away, -depth], 1)
        rotation = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth)).to(depth.dtype)
        return torch.einsum("nji,njhw->nihw", rotation, points)
