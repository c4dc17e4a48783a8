"""Teaching a network to read poses off pictures."""

from __future__ import annotations

import inspect
import math

import torch
from torch import Tensor

from kfit.core import Observation
from kfit.core.check import check_choice, check_positive, check_range
from kfit.generators import PoseHead
from kfit.geometry.pose import rotation_of
from kfit.initializers import PosePosterior
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.random_recolor import RandomRecolor
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.training import Training


class PoseTraining(Training):
    """Shows a pose head views of many objects, each with its true pose.

    L = mean_n KL(target_n ‖ said_n), see `kfit.generators.PoseHead.divergence`.

    The head shares nothing with a generator and learns in a tenth of its time, so it is trained by itself; `kfit pack`
    puts both into one model. Batches are those of `kfit.data.ViewsDataModule`, whose sources and targets are all shown.

    Args:
        pose_head: learns.
        rate: largest learning rate of AdamW; it rises over the first twentieth of the steps and falls as a cosine.
        weight_decay: of AdamW.
        jitter: how views are turned, shifted and scaled; None shows them as they are.
        recolor: how their colours are changed; None leaves them.
        photograph: how they are made to look like cut-outs of photos; None leaves them clean.
        mirror: show half of them left for right, as views from azimuth π − α. Objects of NOCS's categories look much
            the same in a mirror that holds their x and y axes, so that twice as many seem to have been seen.
        compile: compile the head (`torch.compile`). Without a C++ compiler training goes on uncompiled.

    Raises:
        ValueError: when training starts, for a trainer without an end.
    """

    def __init__(
        self,
        pose_head: PoseHead,
        rate: float = 1.5e-3,
        weight_decay: float = 1e-3,
        jitter: RandomSimilarity | None = None,
        recolor: RandomRecolor | None = None,
        photograph: PhotometricAugmentation | None = None,
        mirror: bool = False,
        compile: bool = False,
    ) -> None:
        super().__init__()
        check_positive("rate", rate)
        check_range("weight_decay", weight_decay, 0)
        check_choice("mirror", mirror, (False, True))
        check_choice("compile", compile, (False, True))
        self.remember(inspect.currentframe())
        self.pose_head, self.rate, self.weight_decay = pose_head, rate, weight_decay
        self.jitter, self.recolor, self.photograph = jitter, recolor, photograph
        self.mirror, self.compiles = mirror, compile

    def on_fit_start(self) -> None:
        if self.compiles:
            self.compile_networks(self.pose_head)

    def forward(self, image: Tensor) -> Tensor:
        """Log-probabilities (N, A, E) of the poses that pictures (N, 3, S, S) show."""
        said: Tensor = self.pose_head(image)
        return said

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        image, azimuth, elevation = _views(batch)
        with torch.no_grad():
            if self.photograph is not None:
                image = self.photograph(image, torch.cat([batch["source_mask"], batch["target_mask"]]))
            image = image if self.recolor is None else self.recolor(image)
            image = image if self.jitter is None else self.jitter(image)
            if self.mirror:
                turned = torch.rand_like(azimuth) < 0.5
                image = torch.where(turned.view(-1, 1, 1, 1), image.flip(3), image)
                azimuth = torch.where(turned, math.pi - azimuth, azimuth)
        loss = self.pose_head.divergence(self(image), azimuth, elevation).mean()
        self.log("train/pose", loss.detach(), prog_bar=True)
        return loss

    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log the loss, and how far the likeliest pose is from the truth, by itself."""
        image, azimuth, elevation = _views(batch)
        loss = self.pose_head.divergence(self(image), azimuth, elevation).mean()
        self.log(f"{stage}/pose", loss, prog_bar=True, batch_size=len(image), sync_dist=True)
        likeliest = rotation_of(PosePosterior(self.pose_head)({}, Observation(image), 1, []))
        self.evaluate_rotations(likeliest, azimuth, elevation, self.pose_head.symmetry)


def _views(batch: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Pictures, azimuths and elevations of a batch's sources and targets, one after the other."""
    names = (("source", "target"), ("source_azimuth", "azimuth"), ("source_elevation", "elevation"))
    image, azimuth, elevation = (torch.cat([batch[name] for name in pair]) for pair in names)
    return image, azimuth, elevation
