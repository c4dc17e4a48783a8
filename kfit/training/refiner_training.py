"""Training a network that compares photos with drawings and refines poses."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from kfit.core import Encoder, Generator, frozen
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.geometry import CATEGORIES, PoseUpdate, RefinerNetwork, rotation_from_angles
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.pose_hypotheses import Hypotheses
from kfit.training.random_corruption import occluded
from kfit.training.random_crop import RandomCrop
from kfit.training.random_recolor import RandomRecolor
from kfit.training.refiner_rows import REACH_DEG, RefinerMemory, RefinerRows
from kfit.training.training import Training

# Largest share of an object that is hidden, and the share of pictures in which some is; in half of these it is known.
LARGEST_HIDDEN, HIDDEN = 0.5, 0.3
LOGIT_WEIGHT = 2.0


class RefinerTraining(Training):
    """Trains one refiner for all categories on drawings by frozen generators.

    Each step shows views of new objects, cut out and hidden in parts, with drawings of them at wrong poses with codes
    from the encoders; as many of the last step's objects at the poses to which the refiner has led them; and rows of
    earlier steps again, half of them mirrored. Batches are those of `kfit.data.CategoriesDataModule`; their targets are
    used. See ``kfit.training.refiner_rows.RefinerRows.losses``.

    Args:
        refiner: the network.
        networks: name of a category → its generator and encoder.
        crop: turns views in the plane and cuts them out.
        photometric: augmentation that makes views resemble crops of photos; None leaves them clean.
        recoloring: augmentation of the colours of photo and drawing together.
        rate: largest learning rate of AdamW; it rises over the first twentieth of the steps and falls as a cosine.
        weight_decay: weight decay of AdamW.
        repeats: rows of earlier steps that are shown again, for each one that is drawn.
        memory: number of rows that are kept.
        compile: compile the refiner (`torch.compile`). Without a C++ compiler training continues uncompiled.

    Raises:
        ValueError: for a setting out of range and, when training starts, for a trainer without an end.
    """

    def __init__(
        self,
        refiner: RefinerNetwork,
        networks: Callable[[str], tuple[Generator, Encoder]],
        crop: RandomCrop | None = None,
        photometric: PhotometricAugmentation | None = None,
        recoloring: RandomRecolor | None = None,
        rate: float = 1.5e-3,
        weight_decay: float = 1e-3,
        repeats: int = 4,
        memory: int = 4096,
        compile: bool = False,
    ) -> None:
        super().__init__()
        check_arguments(RefinerTraining, locals(), rate=(check_positive,), weight_decay=(0,), repeats=(0,))
        self.remember(inspect.currentframe())
        self.refiner, self.rate, self.weight_decay, self.compiles = refiner, rate, weight_decay, compile
        self.crop, self.recoloring = crop or RandomCrop(covered=0.0), recoloring or RandomRecolor()
        self.photometric, self.repeats = photometric, repeats
        self._networks, self._loaded = networks, dict[str, tuple[Generator, Encoder]]()
        self._memory, self._walking = RefinerMemory(memory), dict[str, Hypotheses]()

    def on_fit_start(self) -> None:
        if self.compiles:
            self.compile_networks(self.refiner)

    def training_step(self, batch: dict[str, dict[str, Tensor]], batch_idx: int) -> Tensor:
        # Half precision is too coarse for rotations and the places of pixels.
        with torch.no_grad(), torch.autocast(self.device.type, enabled=False):
            hypotheses, drawn = {}, []
            for category, views in batch.items():
                fresh = self._observed(category, views)
                hypotheses[category] = fresh.join(self._walking[category]) if category in self._walking else fresh
                drawn.append(self._drawn(category, hypotheses[category]))
            new = drawn[0].join(*drawn[1:])
            self._memory.add(new)
            rows = new.join(self._shown_again(self.repeats * len(new.error))) if self.repeats else new
        found = self.refiner(rows.observed, rows.drawn)
        losses = rows.losses(found)
        for name, value in losses.items():
            self.log(f"train/{name}", value.detach(), prog_bar=name in ("tilt", "right"))
        with torch.autocast(self.device.type, enabled=False):
            start = 0
            for category, samples in hypotheses.items():
                count, keep = len(samples.focal), len(batch[category]["azimuth"])
                update = PoseUpdate(*(tensor.detach()[start : start + count] for tensor in found))
                chosen = torch.randperm(count, device=self.device)[:keep]
                self._walking[category] = samples.advance(update).select(chosen)
                start += count
        right = losses.pop("right")
        return torch.stack(list(losses.values())).sum() + LOGIT_WEIGHT * right

    def report(self, batch: dict[str, dict[str, Tensor]], stage: str) -> None:
        """Log losses, and rotation errors after one update of hypotheses that are up to 45° off."""
        for category, views in batch.items():
            with torch.random.fork_rng([self.device] if self.device.type == "cuda" else []):
                torch.manual_seed(0)  # the same hypotheses in each epoch
                samples = self._observed(category, views)
            with torch.autocast(self.device.type, enabled=False):
                rows = self._drawn(category, samples)
            found = self.refiner(rows.observed, rows.drawn)
            losses = rows.losses(found)
            total = torch.stack(list(losses.values())).sum() + (LOGIT_WEIGHT - 1) * losses["right"]
            for name, value in {**losses, "loss": total}.items():
                self.log(f"{stage}/{name}", value, prog_bar=name == "loss", batch_size=len(rows.error), sync_dist=True)
            near = (rows.error.rad2deg() < REACH_DEG).nonzero()[:, 0]
            with torch.autocast(self.device.type, enabled=False):
                after = samples.advance(found).select(near)
            self.record_rotations(after.at_rotation, after.rotation, CATEGORIES[category].symmetry)

    def _observed(self, category: str, views: dict[str, Tensor]) -> Hypotheses:
        """Cut out, hide and augment the targets of a batch, and choose hypotheses."""
        _, encoder = self._of(category)
        image, mask = views["target"], views["target_mask"]
        # Half precision is too coarse for rotations and the places of pixels.
        with torch.autocast(self.device.type, enabled=False):
            if self.photometric is not None:
                image, mask = self.photometric.with_mask(image, mask)
            even = torch.rand(3, len(image), device=image.device)
            # What becomes white where something hides the object is a picture of what hides it.
            image, mask = occluded(torch.cat([image, 0 * mask], 1), mask, LARGEST_HIDDEN * even[0] * (even[1] < HIDDEN))
            visible = 1 - image[:, 3:] * (even[2] < 0.5).to(image)[:, None, None, None]
            image, mask, crop = self.crop.draw(image[:, :3], mask)
            # White outside of the picture is no object outside of the mask.
            cut = crop.cut(torch.cat([image, 1 - mask, visible], 1), self.crop.size)
            observed, visible = torch.cat([cut[:, :3], 1 - cut[:, 3:4]], 1).clamp(0, 1), (cut[:, 4:] > 0.5).to(cut)
            rotation = rotation_from_angles(views["azimuth"], views["elevation"], crop.roll)
            shift = crop.centre * image.new_tensor([-2.0, 2.0]) / crop.side[:, None]
            log_scale, fraction = (image.shape[-1] / crop.side).log(), CATEGORIES[category].unit_fraction
            truth = (rotation, shift, log_scale, views["distance"])
            return Hypotheses.sample(observed, *truth, visible, encoder, fraction)

    def _drawn(self, category: str, hypotheses: Hypotheses) -> RefinerRows:
        return hypotheses.draw(self._of(category)[0], CATEGORIES[category].symmetry)

    def _shown_again(self, count: int) -> RefinerRows:
        """Any earlier rows, half of them mirrored, recoloured alike in photo and drawing."""
        rows = self._memory.sample(count)
        rows = rows.mirrored(torch.rand_like(rows.error) < 0.5)
        side = rows.observed.shape[-1]
        both = self.recoloring(torch.cat([rows.observed[:, :3], rows.drawn[:, :3]], 3))
        return rows._replace(
            observed=torch.cat([both[..., :side], rows.observed[:, 3:]], 1),
            drawn=torch.cat([both[..., side:], rows.drawn[:, 3:]], 1),
        )

    def _of(self, category: str) -> tuple[Generator, Encoder]:
        if category not in self._loaded:
            parts: tuple[Any, Any] = self._networks(category)
            self._loaded[category] = tuple(frozen(part).to(self.device) for part in parts)  # type: ignore[assignment]
        return self._loaded[category]
