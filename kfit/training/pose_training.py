"""Training of a network that predicts poses."""

from __future__ import annotations

import inspect
import math

import torch
from lightning.pytorch.cli import LRSchedulerCallable, OptimizerCallable
from torch import Tensor

from kfit.core import Observation
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.generators import RotationHead
from kfit.geometry.pose import rotation_of
from kfit.initializers import PosePosterior
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.random_crop import RandomCrop, crop_rolled
from kfit.training.random_recolor import RandomRecolor
from kfit.training.training import Training


class PoseTraining(Training):
    """Train a pose head on views of many objects with their true rotations.

    L = mean_n KL(target_n ‖ prediction_n), see `kfit.generators.RotationHead.divergence`.

    The head shares nothing with a generator, so it is trained alone; `kfit pack` combines both in one model. Batches
    are those of `kfit.data.ViewsDataModule`; their sources and targets are both used.

    Args:
        pose_head: the network.
        crop: random rotation and crop of views.
        rate: largest learning rate of AdamW; it rises over the first twentieth of the steps and falls as a cosine.
        weight_decay: weight decay of AdamW.
        recoloring: augmentation of colours; None for none.
        photometric: augmentation that makes views resemble crops of photos; None leaves them clean.
        mirror: flip half of the views, which changes azimuth α to π − α and roll ρ to −ρ. Objects of NOCS's categories
            are similar to their mirror images about the x–y plane, so this doubles the objects.
        compile: compile the head (`torch.compile`). Without a C++ compiler training goes on uncompiled.
        optimizer, scheduler: as in ``kfit.training.training.Training``; ``rate`` and ``weight_decay`` are of its AdamW.

    Raises:
        ValueError: when training starts, if the trainer has no end.
    """

    def __init__(
        self,
        pose_head: RotationHead,
        crop: RandomCrop | None = None,
        rate: float = 1.5e-3,
        weight_decay: float = 1e-3,
        recoloring: RandomRecolor | None = None,
        photometric: PhotometricAugmentation | None = None,
        mirror: bool = True,
        compile: bool = False,
        optimizer: OptimizerCallable | None = None,
        scheduler: LRSchedulerCallable | None = None,
    ) -> None:
        super().__init__(optimizer, scheduler)
        check_arguments(PoseTraining, locals(), rate=(check_positive,), weight_decay=(0,))
        self.remember(inspect.currentframe())
        self.pose_head, self.rate, self.weight_decay = pose_head, rate, weight_decay
        self.crop, self.recoloring, self.photometric = crop or RandomCrop(), recoloring, photometric
        self.mirror, self.compiles = mirror, compile

    def on_fit_start(self) -> None:
        if self.compiles:
            self.compile_networks(self.pose_head.features)

    def forward(self, image: Tensor) -> Tensor:
        """Return log-probabilities (N, B) of the rotations of pictures (N, 3, S, S)."""
        log_probability: Tensor = self.pose_head(image)
        return log_probability

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        image, mask, azimuth, elevation = _views(batch)
        # Half precision is too coarse for the places of pixels.
        with torch.no_grad(), torch.autocast(self.device.type, enabled=False):
            if self.photometric is not None:
                image = self.photometric(image, mask)
            image = image if self.recoloring is None else self.recoloring(image)
            image, roll = self.crop(image, mask)
            if self.mirror:
                flipped = torch.rand_like(azimuth) < 0.5
                image = torch.where(flipped.view(-1, 1, 1, 1), image.flip(3), image)
                azimuth = torch.where(flipped, math.pi - azimuth, azimuth)
                roll = torch.where(flipped, -roll, roll)
        loss = self.pose_head.divergence(image, azimuth, elevation, roll).mean()
        self.log("train/pose", loss.detach(), prog_bar=True)
        return loss

    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log the loss and the error of the likeliest rotation, for rolls over the full circle."""
        image, mask, azimuth, elevation = _views(batch)
        golden = math.pi * (3 - math.sqrt(5))  # the same rolls in each epoch
        roll = (golden * torch.arange(len(image), device=image.device, dtype=image.dtype)) % (2 * math.pi)
        image = crop_rolled(image, mask, roll, self.crop.size)
        log_probability = self(image)
        target = self.pose_head.log_kernel(azimuth, elevation, roll)
        loss = (target.exp() * (target - log_probability)).sum(1).mean()
        self.log(f"{stage}/pose", loss, prog_bar=True, batch_size=len(image), sync_dist=True)
        # The head runs once: its rotations of all rolls make validation slower than training where views are few.
        known = {self.pose_head.prediction_name: log_probability.detach()}
        likeliest = rotation_of(PosePosterior(self.pose_head)({}, Observation(image, predictions=known), 1, []))
        truth = rotation_of({"azimuth": azimuth, "elevation": elevation, "roll": roll})
        self.record_rotations(likeliest, truth, self.pose_head.symmetry)


def _views(batch: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pictures, masks, azimuths and elevations of a batch's sources and targets, one after the other."""
    names = (
        ("source", "target"),
        ("source_mask", "target_mask"),
        ("source_azimuth", "azimuth"),
        ("source_elevation", "elevation"),
    )
    image, mask, azimuth, elevation = (torch.cat([batch[name] for name in pair]) for pair in names)
    return image, mask, azimuth, elevation
