"""The paper's own fit: VGG16's features and a prior of weight 1 (Chen et al. 2020, section 4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from kfit import FitPipeline
from kfit.bench.paper.fits import Schedule
from kfit.core import Energy, Initializer, Prior
from kfit.energies import L1, L2, SSIM, CodePrior, Depth, Perceptual
from kfit.features import VGG16
from kfit.generators import MetricDepth, SimilarityWarp, fixed_camera
from kfit.initializers import Constant, EncoderPosterior, FromCamera, FromDepth, FromMask, SphereGrid
from kfit.optimizers import Adam
from kfit.pose import CategoryModel
from kfit.pose.defaults import DISTANCE_RATE
from kfit.selectors import RotationVote

RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01, "roll": 0.01, "shift": 0.03, "scale": 0.03}
# VGG16's features leave about 10 after a fit (12 views of laptops and mugs by the bundled models). Where these leave
# 0.05, 0.01 and 0.09, the code prior has a weight in proportion: with a weight of 1 it would fix the code at 0.
ENERGIES: dict[str, tuple[Callable[[], Energy], float]] = {"l1": (L1, 0.005), "l2": (L2, 0.001), "ssim": (SSIM, 0.009)}
# Weight of depth in box diagonals, one more channel of the picture: 0.05 of it costs as much as 0.05 of L1.
DEPTH_WEIGHT = 200.0


def published_fit(model: CategoryModel, vgg16: str, schedule: Schedule, how: str = "") -> FitPipeline:
    """Put the paper's fit together: E = features of VGG16, relu3_3, + 1 · code prior, by Adam at the released rates.

    Nothing is pruned, and of the five best starts the one wins that most of them agree with, as in the released code
    (neural_object_fitting@7309348, eval.py). With depth, its L1 distance is one more term and tz one more variable.

    Args:
        model: a `kfit.generators.VAE3D`.
        vgg16: file of VGG16's ImageNet weights.
        schedule: the paper's has 32 starts and 50 steps.
        how: "" for the method itself; "l1", "l2" or "ssim" for another energy, with a prior in proportion; "no_prior";
            "depth"; "robustness" where pictures are not cut out around their objects, so that drawings start where the
            mask is.
    """
    energies: dict[str, Energy | Prior] = {}
    weights: dict[str, float] = {}
    if how in ENERGIES:
        make, weights["prior"] = ENERGIES[how]
        energies[how] = make()
    else:
        energies["perceptual"] = Perceptual(VGG16(["relu3_3"], weights=vgg16))
    if how != "no_prior":
        energies["prior"] = CodePrior()
    drawn: Any = SimilarityWarp(fixed_camera(model.generator))
    rates = dict(RATES)
    place: list[Initializer] = [FromMask()] if how == "robustness" else [Constant({"shift": 0.0})]
    starts: list[Initializer] = [
        SphereGrid(elevation_deg=(45.0, 45.0)),
        EncoderPosterior(model.encoder),
        Constant({"roll": 0.0, "scale": 1.0}),
        *place,
    ]
    if how == "depth":
        drawn = MetricDepth(drawn, model.card.unit_fraction)
        energies["depth"], weights["depth"] = Depth(), DEPTH_WEIGHT / model.card.mean_diagonal
        starts = [FromDepth(drawn, [*starts, FromCamera()])]
        rates |= {"focal": 0.0, "distance": DISTANCE_RATE}  # the lens is known
    return FitPipeline(
        drawn,
        energies,
        starts,
        Adam(rates, (0.5, 0.999)),
        weights=dict(weights),
        selector=RotationVote(symmetry=model.card.known.symmetry),
        num_starts=schedule.starts,
        num_steps=schedule.steps,
    )
