"""A trained model of one category, which finds poses in photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Callback, Energy, FitError, FitResult, Observation, Rendering, Variables
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import RadianceField, SimilarityWarp
from kfit.generators.drawn_fields import drawn_fields
from kfit.geometry import to_opencv
from kfit.geometry.pose_network import with_prediction
from kfit.pose.category_networks import CategoryNetworks
from kfit.pose.covariance import pose_covariance
from kfit.pose.default_fit import default_fit
from kfit.pose.defaults import default_energies
from kfit.pose.hypotheses import fitted_rotations, hypotheses_of
from kfit.pose.interpretation import interpret
from kfit.pose.observed_object import ObservedObject
from kfit.pose.placement import placement
from kfit.pose.result import PoseResult
from kfit.pose.views import Box, PhotoLike, observe, triangulated_diagonal
from kfit.runtime.devices import safe_after_fork
from kfit.segmentation import Segmenter


class CategoryModel(CategoryNetworks):
    """The networks of one category, and the fit that explains photos with them.

    Args:
        generator: generator with ``code``, ``azimuth`` and ``elevation``.
        encoder: picture → Gaussian over the code.
        extents: code → the object's normalised sides.
        card: description of the networks.
        pose_head: picture → distribution over poses; None if the model has none.

    Example:
        >>> import numpy as np, kfit
        >>> image, mask = np.ones((96, 96, 3)), np.zeros((96, 96))
        >>> image[20:80, 30:70], mask[20:80, 30:70] = (0.7, 0.2, 0.1), 1
        >>> model = kfit.load("mug")
        >>> short = model.pipeline(num_starts=1, num_steps=1)  # for this example
        >>> model.pose(image, mask=mask, pipeline=short).rotation.shape
        (3, 3)
    """

    def pipeline(
        self,
        num_starts: int = 4,
        num_steps: int = 16,
        callbacks: Sequence[Callback] | None = None,
        depth: bool = False,
        lens_known: bool = True,
        views: float | None = None,
        energies: Mapping[str, tuple[Energy, float]] | None = None,
    ) -> FitPipeline:
        """Build the fit that `pose` runs: the paper's, with an energy that needs no download.

        Poses start at the peaks of the pose head's distribution, or without a head on an even grid over the valid part
        of the sphere, and codes are drawn from the encoder's posterior: 4 × as many candidates as starts, 16 × without
        a head, each drawn once to choose the best. More starts and steps found no better poses of 40 unseen mugs,
        laptops and cans each. The optimizer is Adam with the released rates, which decay. E = features of
        EfficientNet-Lite0 + 2 · SSIM + 5 · silhouette + 0.02 · code prior + the card's pose weight · prior of the pose
        head and, with depth, 0.5 · Geman and McClure's kernel of the depth difference over 0.05 mean box diagonals.
        ``kfit bench energies`` compares alternatives to the first three. A generator that draws no mask is fitted
        without the silhouette.

        Args:
            num_starts, num_steps: as in `kfit.FitPipeline`.
            callbacks: by default pruning to half of the starts at step 3.
            depth: whether the observation has depth, which determines the distance; the generator must draw depth.
            lens_known: whether the observation's intrinsics are known. If not, their focal length is the start of a
                fitted one, with the prior `kfit.energies.LensPrior`.
            views: box diagonal in metres at which fits to several views of each object start, whose cameras determine
                distance and size; None for one view.
            energies: energies between rendering and photo, by name and with their weights, instead of the first three.
        """
        if energies is None:
            energies = {name: one for name, one in default_energies().items() if one[0].on in self.drawn}
        return default_fit(
            self.generator,
            self.encoder,
            self.pose_head,
            self.card,
            self.image_size,
            energies,
            num_starts=num_starts,
            num_steps=num_steps,
            callbacks=callbacks,
            depth=depth,
            lens_known=lens_known,
            views=views,
        ).to(self.device)

    @cached_property
    def drawn(self) -> frozenset[str]:
        """Names of the fields that its generator draws, of ``image``, ``mask`` and ``depth``."""
        return drawn_fields(self.generator, next(self.encoder.parameters()))

    @safe_after_fork()
    @torch.inference_mode(False)
    def pose(
        self,
        image: PhotoLike | Sequence[PhotoLike],
        mask: NDArray[Any] | Sequence[NDArray[Any]] | None = None,
        box: Box | Sequence[Box] | None = None,
        intrinsics: NDArray[Any] | Tensor | None = None,
        depth: NDArray[Any] | None = None,
        *,
        ignore: NDArray[Any] | None = None,
        relative_poses: NDArray[Any] | Tensor | None = None,
        segmenter: str | Path | Segmenter | Sequence[Segmenter] | None = None,
        seed: int = 0,
        pipeline: FitPipeline | None = None,
        callbacks: Sequence[Callback] = (),
    ) -> PoseResult:
        """Find the object's pose, size and appearance in a photo.

        The mask is ``mask``, else the segmenter's, else GrabCut's in ``box``, else the file's alpha channel, else
        GrabCut's in the whole picture. The intrinsics are ``intrinsics``, else those of the file's EXIF tags; else the
        focal length is fitted too, mostly by its prior over lenses and distances. Distance and size in metres follow
        from ``depth`` or, without it, from the category's mean size.

        Args:
            image: path of a photo, the result of `kfit.segmentation.read_photo`, or (H, W, 3)
                RGB: uint8, or floating point in [0, 1]. A list of V of these is V photos of one object by cameras with
                known lenses and relative poses; ``mask`` and ``box`` are then lists too, ``intrinsics`` and
                ``segmenter`` may be, and the answer is in the first camera.
            mask: (H, W), above one half of its full scale (1, 255 or 65535) on the object.
            box: left, top, width, height in pixels.
            intrinsics: (3, 3).
            depth: (H, W) in metres along the camera's axis; values that are not finite and above 0 are unknown.
            ignore: (H, W), above one half of its full scale where something else hides the object: pixels do not count
                there. The object may continue behind it.
            relative_poses: (V, 4, 4), map points in the first camera to each of V cameras (OpenCV axes, metres); the
                first is the identity. They determine distance and size.
            segmenter: finds the object in ``box``, or without one the object of this category with the highest score:
                an ONNX file that `kfit.segmentation.load_segmenter` reads, or any `kfit.segmentation.Segmenter`.
            seed: determines the random numbers.
            pipeline: another fit than that of `pipeline`; its generator needs the same variables.
            callbacks: watch this fit, besides the pipeline's own.

        Raises:
            FileNotFoundError, ValueError: if inputs cannot be used, in one sentence.
        """
        observed, observation = observe(
            image, self.card.known, self.image_size, mask, box, intrinsics, depth, ignore, relative_poses, segmenter
        )
        if pipeline is None and observation.views > 1:
            start = triangulated_diagonal(observation, self.card.unit_fraction, self.card.mean_diagonal)
            pipeline = self.pipeline(views=start)
        fit = pipeline or self.pipeline(depth=depth is not None, lens_known=observed.lens_known)
        observation = self.read(observation.map(lambda tensor: tensor.to(fit.device)))
        return self.answer(fit(observation, seed=seed, callbacks=callbacks), observed, observation)

    @property
    def image_size(self) -> int:
        """Side in pixels of the pictures that the generator draws."""
        return int(getattr(self.generator, "image_size", 64))

    @safe_after_fork()
    def draw(self, values: Variables) -> Rendering:
        """Draw N values of a fit, on the CPU and without a gradient."""
        warped = SimilarityWarp(self.generator)
        with torch.no_grad():
            there = [name for name in warped.variables if name in values]
            return warped(**{name: values[name].to(self.device) for name in there}).map(Tensor.cpu)

    def read(self, observation: Observation) -> Observation:
        """Return the observation with the pose head's prediction, so that fit and answer need not run it again."""
        return observation if self.pose_head is None else with_prediction(observation, self.pose_head)

    def pose_log_probabilities(self, observation: Observation) -> Tensor | None:
        """Return log-probabilities (B, bins) of the poses of B problems on the CPU, or None without a pose head."""
        if self.pose_head is None:
            return None
        return with_prediction(observation, self.pose_head).predictions[self.pose_head.prediction_name].cpu()

    def answer(self, fit: FitResult, observed: ObservedObject, observation: Observation) -> PoseResult:
        """Return the answer of a fit of one problem; arguments as those of `answers`."""
        if (answer := self.answers(fit, [observed], observation)[0]) is None:
            raise FitError("every start of the fit became NaN or infinite")
        return answer

    @safe_after_fork()
    def answers(
        self, fit: FitResult, observed: Sequence[ObservedObject], observation: Observation
    ) -> list[PoseResult | None]:
        """Return the answers of a fit, one for each problem; None if all its starts failed.

        Args:
            fit: fit of B problems.
            observed: B objects.
            observation: observation that was fitted, as `read` returned it.
        """
        with torch.no_grad():
            extents = self.extents(fit.values["code"].to(self.device)).double().cpu()
        drawn = self.draw(fit.values)
        log_probabilities = self.pose_log_probabilities(observation)
        by_head = [None] * len(observed) if log_probabilities is None else list(log_probabilities)
        fit = fit.to("cpu")
        return [
            self._interpreted(fit[n], one, extents[n], drawn.map(itemgetter(slice(n, n + 1))), by_head[n])
            if fit.start[n] >= 0
            else None
            for n, one in enumerate(observed)
        ]

    def _interpreted(
        self, fit: FitResult, observed: ObservedObject, extents: Tensor, drawing: Rendering, by_head: Tensor | None
    ) -> PoseResult:
        rotation, translation, diagonal = placement(fit.values, observed.crop, observed.intrinsics, self.card)
        # From the crop's virtual camera to the photo's: the same rotation for every start, up to their shifts.
        turn = rotation[0] @ to_opencv(fitted_rotations(fit.values))[0].mT
        hypotheses = hypotheses_of(fit, turn, self.card, self.pose_head, by_head)
        placed = (rotation[0], translation[0], extents * diagonal)
        generator, surface = self.generator, None
        if isinstance(generator, RadianceField):
            surface = partial(generator.surface, fit.values["code"][0].to(self.device))
        covariance = partial(pose_covariance, fit, observed, self.card, self.draw)
        return interpret(self.card.known, fit, observed, placed, hypotheses, drawing, self.draw, covariance, surface)
