"""Training a generator and its encoder as a conditional variational autoencoder: the paper's objective."""

from __future__ import annotations

import inspect
import warnings

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torchmetrics.functional.image import structural_similarity_index_measure
from torchmetrics.functional.segmentation import mean_iou

from kfit.core import Encoder, Energy, Generator, Observation, Rendering, frozen
from kfit.core.check import check_choice, check_count, check_dict, check_names, check_positive, check_range
from kfit.generators import ExtentsHead
from kfit.geometry import Symmetry
from kfit.geometry.pose import rotation_of
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.short_fit import fitted_rotations
from kfit.training.training import Training
from kfit.training.view_lens import view_lens

TAKEN = {"extents", "kl", "l1", "loss", "mask_iou", "ssim"}  # logged with the losses
FIT_EVERY = 5  # views in test: a fit takes a second of a core, and an object has some ten views


class ConditionalVAE(Training):
    """Sees one view of an object and must draw another (Chen et al. 2020, section 3.2).

    L = Σ_k w_k · mean_n e_k(G(z, pose), I) + λ · D_KL + w_ext · ‖extents(z) − extents‖₁,
    z = μ + σ·ε from the encoder's look at the other view, and
    D_KL = mean_n Σ_d ½ (μ² + σ² − 1 − log σ²) in nats, summed over the code and averaged over the batch, where each
    energy averages over pixels and channels.

    The paper's λ is 1e-2, for terms of unknown normalisation. As they are normalised here, 1e-2 lets codes
    collapse, and 1e-4 is the default. The released code would weigh 10 · L1 + 0.01 · (KL averaged over the code), which
    is λ = 6e-5 here for a code of 16, but never adds the KL term.

    Batches are those of `kfit.data.ViewsDataModule`; without extents in them, extents are not learned.

    Args:
        generator: of variables ``code``, ``azimuth`` and ``elevation``.
        encoder: picture → Gaussian over the code.
        extents: code → the object's three sides.
        losses: energies of drawing against target, by name; each on the field that it names. They are frozen here,
            so that networks in them are not trained.
        loss_weights: by name; 1 where not given.
        kl_weight: λ.
        extents_weight: w_ext.
        rate: largest learning rate of Adam; it rises over the first twentieth of the steps and falls as a cosine.
        jitter: how the encoder's view is disturbed; None shows it as it is.
        photograph: how that view is made to look like a cut-out of a photo first; None leaves it clean.
        pixel_stride: draw and compare every such row and column of the target alone, from a random first one on, which
            is less work where a generator draws pixels by themselves, as `kfit.generators.RadianceField` does. Losses
            that look at neighbourhoods see thinned pictures.
        compile: compile the networks (`torch.compile`): half a minute of waiting for about 1.7 times the speed.
            Without a C++ compiler training goes on uncompiled.
        symmetry: of the objects, by which test tells how far rotations are off; ``lightning`` sets the category's.

    Raises:
        ValueError: for loss weights of unknown names, losses of names that are taken, a ``pixel_stride`` below 1, or
            above 1 with a generator that draws whole pictures only, and, when training starts, a trainer without an
            end.
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
        jitter: RandomSimilarity | None = None,
        compile: bool = False,
        pixel_stride: int = 1,
        photograph: PhotometricAugmentation | None = None,
        symmetry: Symmetry = "none",
    ) -> None:
        super().__init__()
        check_range("kl_weight", kl_weight, 0)
        check_range("extents_weight", extents_weight, 0)
        check_positive("rate", rate)
        check_choice("compile", compile, (False, True))
        check_choice("symmetry", symmetry, ("none", "y"))
        check_count("pixel_stride", pixel_stride, 1, 64)
        if pixel_stride > 1 and "pixels" not in inspect.signature(generator.forward).parameters:
            kind = type(generator).__name__
            raise ValueError(f"pixel_stride: {kind} draws whole pictures only, so it must be 1, got {pixel_stride}")
        if loss_weights is not None:
            check_dict("loss_weights", loss_weights, check_range)
            check_names("loss_weights", loss_weights, losses)
        if taken := sorted(TAKEN & set(losses)):
            raise ValueError(f"losses: {', '.join(taken)} is a name that is taken; name the loss otherwise")
        self.remember(inspect.currentframe())
        self.generator, self.encoder, self.extents = generator, encoder, extents
        self.losses = frozen(nn.ModuleDict(losses))
        self.loss_weights = {name: 1.0 for name in losses} | (loss_weights or {})
        self.kl_weight, self.extents_weight, self.rate = kl_weight, extents_weight, rate
        self.jitter, self.photograph, self.compiles, self.pixel_stride = jitter, photograph, compile, pixel_stride
        self.symmetry = symmetry

    def on_fit_start(self) -> None:
        # Fixed networks, in the losses and in encoders, stay in evaluation mode, as they should.
        warnings.filterwarnings("ignore", message=r"Found \d+ module\(s\) in eval mode")
        if self.compiles:
            self.compile_networks(self.generator, self.encoder)

    def forward(self, image: Tensor, azimuth: Tensor, elevation: Tensor, **lens: Tensor) -> Rendering:
        """Draw the objects of pictures (N, 3, S, S) from other sides, each (N,) in radians, by a ``focal`` if given."""
        mean, _ = self.encoder(image)
        drawn: Rendering = self.generator(code=mean, azimuth=azimuth, elevation=elevation, **lens)
        return drawn

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        seen = batch["source"]
        if self.photograph is not None:
            seen = self.photograph(seen, batch["source_mask"])
        seen = seen if self.jitter is None else self.jitter(seen)
        mean, log_variance = self.encoder(seen)
        code = mean + (0.5 * log_variance).exp() * torch.randn_like(mean)
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

        Logged are the losses, L1, SSIM and the IoU of masks, how far the extents are off, and in test what
        ``record_rotations`` logs of short fits to every fifth of the other views.
        """
        lens = view_lens(self.generator, batch)
        drawn = self(batch["source"], batch["azimuth"], batch["elevation"], **lens)
        terms = self._compare(drawn, batch)
        if "extents" in batch:
            terms["extents"] = F.l1_loss(self.extents(self.encoder(batch["source"])[0]), batch["extents"])
        size = len(batch["target"])
        with torch.autocast(self.device.type, enabled=False):  # in halves, SSIM's variances would be noise
            away = F.l1_loss(drawn.image.float(), batch["target"])
            alike = structural_similarity_index_measure(drawn.image.float(), batch["target"], data_range=1.0)
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
            seen = Observation(image, None if drawn.mask is None else mask, intrinsics=cameras)
            truth = rotation_of({"azimuth": azimuth, "elevation": elevation})
            self.record_rotations(fitted_rotations(self.generator, self.encoder, seen), truth, self.symmetry)

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
