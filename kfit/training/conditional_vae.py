"""Training a generator and its encoder as a conditional variational autoencoder: the paper's objective."""

from __future__ import annotations

import inspect
import logging
import warnings

import torch
from lightning.pytorch.cli import LRSchedulerCallable, OptimizerCallable
from torch import Tensor, nn
from torch.nn import functional as F
from torchmetrics.functional.image import structural_similarity_index_measure
from torchmetrics.functional.segmentation import mean_iou

from kfit.core import Encoder, Energy, Generator, Observation, Rendering, frozen
from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.generators import ExtentsHead
from kfit.geometry import Symmetry, check_symmetry
from kfit.geometry.pose import rotation_of
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.short_fit import fitted_rotations
from kfit.training.training import Training
from kfit.training.view_lens import view_lens

_log = logging.getLogger(__name__)
TAKEN = {"extents", "kl", "l1", "loss", "mask_iou", "ssim"}  # logged with the losses
FIT_EVERY = 5  # views in test: a fit takes a second of a core, and an object has some ten views


class ConditionalVAE(Training):
    """Train a generator and an encoder to draw one view of an object from another (Chen et al. 2020, section 3.2).

    L = Σ_k w_k · mean_n e_k(G(z, pose), I) + λ · D_KL + w_ext · ‖extents(z) − extents‖₁,
    z = μ + σ·ε from the encoder's output for the other view, and
    D_KL = mean_n Σ_d ½ (μ² + σ² − 1 − log σ²) in nats, summed over the code and averaged over the batch, where each
    energy averages over pixels and channels.

    The paper's λ is 1e-2, for terms of unknown normalisation. With the normalisation here, codes
    collapse at 1e-2, and 1e-4 is the default. The released code has weights for 10 · L1 + 0.01 · (KL averaged over the
    code), which is λ = 6e-5 here for a code of 16, but never adds the KL term.

    Batches are those of `kfit.data.ViewsDataModule`; without extents in them, extents are not learned.

    Args:
        generator: generator with variables ``code``, ``azimuth`` and ``elevation``.
        encoder: picture → Gaussian over the code.
        extents: code → the object's three sides.
        losses: energies of drawing and target, by name. They are frozen, so that networks in them are not trained.
        loss_weights: by name; 1 by default.
        kl_weight: λ.
        extents_weight: w_ext.
        rate: largest learning rate of Adam; it rises over the first twentieth of the steps and falls as a cosine.
        similarity: random motion of the encoder's view; None for no motion.
        photometric: augmentation that makes the encoder's view resemble a crop of a photo; None for none.
        pixel_stride: draw and compare every such row and column of the target only, from a random first one on, which
            saves work if a generator draws pixels independently, as `kfit.generators.RadianceField` does. Losses on
            neighbourhoods then compare subsampled pictures.
        compile: compile the networks (`torch.compile`), which takes 30 s and makes training about 1.7 × as fast.
            Without a C++ compiler training continues uncompiled.
        symmetry: symmetry of the objects, for rotation errors in test; ``lightning`` sets the category's.
        optimizer, scheduler: as in ``kfit.training.training``; ``rate`` and ``weight_decay`` are for its AdamW.

    Raises:
        ValueError: if a loss has a reserved name (extents, kl, l1, loss, mask_iou, ssim), ``pixel_stride`` is below 1,
            or above 1 with a generator that draws complete pictures only and, when training starts, if the trainer has
            no end.
    """

    def __init__(
        self,
        generator: Generator,
        encoder: Encoder,
        extents: ExtentsHead,
        losses: dict[str, Energy],
        loss_weights: dict[str, float] | None = None,
        kl_weight: float = 1e-4,
        extents_weight: float = 0.1,
        rate: float = 2e-3,
        similarity: RandomSimilarity | None = None,
        compile: bool = False,
        pixel_stride: int = 1,
        photometric: PhotometricAugmentation | None = None,
        symmetry: Symmetry = "none",
        optimizer: OptimizerCallable | None = None,
        scheduler: LRSchedulerCallable | None = None,
    ) -> None:
        super().__init__(optimizer, scheduler)
        check_arguments(
            ConditionalVAE,
            locals(),
            symmetry=(check_symmetry,),
            kl_weight=(0,),
            extents_weight=(0,),
            rate=(check_positive,),
            pixel_stride=(1, 64),
        )
        if pixel_stride > 1 and "pixels" not in inspect.signature(generator.forward).parameters:
            kind = type(generator).__name__
            raise ValueError(f"pixel_stride: {kind} draws whole pictures only, so it must be 1, got {pixel_stride}")
        if loss_weights is not None and (unused := sorted(set(loss_weights) - set(losses))):
            # A recipe's weights stay behind when its losses are replaced.
            names, known = ", ".join(unused), ", ".join(losses)
            _log.warning("loss_weights: %s has no effect, as the losses are %s", names, known)
            loss_weights = {name: weight for name, weight in loss_weights.items() if name in losses}
        if taken := sorted(TAKEN & set(losses)):
            reserved = ", ".join(sorted(TAKEN))
            raise ValueError(f"losses: the name {taken[0]} is reserved for the log, which uses {reserved}")
        self.remember(inspect.currentframe())
        self.generator, self.encoder, self.extents = generator, encoder, extents
        self.losses = frozen(nn.ModuleDict(losses))
        self.loss_weights = {name: 1.0 for name in losses} | (loss_weights or {})
        self.kl_weight, self.extents_weight, self.rate = kl_weight, extents_weight, rate
        self.similarity, self.photometric, self.compiles, self.pixel_stride = (
            similarity,
            photometric,
            compile,
            pixel_stride,
        )
        self.symmetry = symmetry

    def on_fit_start(self) -> None:
        # Fixed networks, in the losses and in encoders, stay in evaluation mode, as they should.
        warnings.filterwarnings("ignore", message=r"Found \d+ module\(s\) in eval mode")
        if self.compiles:
            self.compile_networks(self.generator, self.encoder)

    def forward(self, image: Tensor, azimuth: Tensor, elevation: Tensor, **lens: Tensor) -> Rendering:
        """Draw the objects of pictures (N, 3, S, S) at other angles, (N,) in radians, with an optional ``focal``."""
        mean, _ = self.encoder(image)
        drawn: Rendering = self.generator(code=mean.to(self.dtype), azimuth=azimuth, elevation=elevation, **lens)
        return drawn

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        observed = batch["source"]
        if self.photometric is not None:
            observed = self.photometric(observed, batch["source_mask"])
        observed = observed if self.similarity is None else self.similarity(observed)
        mean, log_variance = self.encoder(observed)
        # Encoders give single precision, whatever their weights have.
        code = (mean + (0.5 * log_variance).exp() * torch.randn_like(mean)).to(self.dtype)
        batch, thinned = self._thin(batch)
        pose = {"azimuth": batch["azimuth"], "elevation": batch["elevation"]} | view_lens(self.generator, batch)
        drawn = self.generator(code=code, **pose, **thinned)
        divergence = 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(1).mean()
        terms = self._compare(drawn, batch)
        if "extents" in batch:
            terms["extents"] = F.l1_loss(self.extents(code), batch["extents"])
        weights = self.loss_weights | {"extents": self.extents_weight}
        loss = sum((weights[name] * term for name, term in terms.items()), self.kl_weight * divergence)
        self.log_dict({f"train/{k}": v.detach() for k, v in terms.items()} | {"train/kl": divergence.detach()})
        self.log("train/loss", loss.detach(), prog_bar=True)
        return loss

    def report(self, batch: dict[str, Tensor], stage: str) -> None:
        """Log how well the encoder's code of one view draws another, and in test also the errors of poses.

        It logs the losses, L1, SSIM, the IoU of masks, the error of extents and, in test, the errors of
        ``record_rotations`` for short fits to every fifth of the other views.
        """
        lens = view_lens(self.generator, batch)
        drawn = self(batch["source"], batch["azimuth"], batch["elevation"], **lens)
        terms = self._compare(drawn, batch)
        if "extents" in batch:
            terms["extents"] = F.l1_loss(
                self.extents(self.encoder(batch["source"])[0].to(self.dtype)), batch["extents"]
            )
        size = len(batch["target"])
        with torch.autocast(self.device.type, enabled=False):  # in halves, SSIM's variances would be noise
            away = F.l1_loss(drawn.image.float(), batch["target"].float())
            alike = structural_similarity_index_measure(drawn.image.float(), batch["target"].float(), data_range=1.0)
            terms["ssim"] = torch.as_tensor(alike)
            if drawn.mask is not None:
                mask, true = ((mask > 0.5).long()[:, 0] for mask in (drawn.mask, batch["target_mask"]))
                shared = mean_iou(mask, true, num_classes=2, include_background=False, input_format="index")
                terms["mask_iou"] = shared.mean()
        self.log_dict({f"{stage}/{k}": v for k, v in terms.items()}, batch_size=size, sync_dist=True)
        self.log(f"{stage}/l1", away, prog_bar=True, batch_size=size, sync_dist=True)
        if stage == "test":
            image, mask, azimuth, elevation = (
                batch[name][::FIT_EVERY] for name in ("target", "target_mask", "azimuth", "elevation")
            )
            cameras = None
            if lens:
                focal = image.shape[-1] * lens["focal"][::FIT_EVERY]
                cameras = torch.diag_embed(torch.stack([focal, focal, torch.ones_like(focal)], 1))
            observed = Observation(image, None if drawn.mask is None else mask, intrinsics=cameras)
            truth = rotation_of({"azimuth": azimuth, "elevation": elevation})
            self.record_rotations(fitted_rotations(self.generator, self.encoder, observed), truth, self.symmetry)

    def _thin(self, batch: dict[str, Tensor]) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """Return the batch with a subset of its targets' pixels, and the generator's arguments to draw them."""
        every = self.pixel_stride
        if every == 1:
            return batch, {}
        side = batch["target"].shape[-1]
        kept = torch.arange(0, side - every + 1, every) + torch.randint(every, (2, 1))
        kept = kept.to(batch["target"].device)
        targets = {name: value for name, value in batch.items() if name.startswith("target")}
        return batch | {k: v[..., kept[0], :][..., kept[1]] for k, v in targets.items()}, {"pixels": kept}

    def _compare(self, drawn: Rendering, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        target = Rendering(batch["target"], batch["target_mask"], batch.get("target_depth"))
        return {
            name: energy(drawn.select(energy.on), target.select(energy.on)).mean()  # type: ignore[arg-type]
            for name, energy in self.losses.items()
        }
