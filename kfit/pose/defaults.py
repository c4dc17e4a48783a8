"""What a fit uses unless said otherwise: rates, weights and energies."""

from __future__ import annotations

from collections.abc import Mapping

from kfit.core import Encoder, Energy, Generator, Initializer, Prior
from kfit.energies import SSIM, CodePrior, Depth, GemanMcClure, LensPrior, Perceptual, PosePrior, Silhouette
from kfit.features import EfficientNetLite0
from kfit.geometry import PoseNetwork
from kfit.initializers import Constant, EncoderPosterior, FromCamera, FromDepth, PosePosterior, SphereGrid
from kfit.pose.card import Card
from kfit.pose.confidence import LENS_WEIGHT

# Raw units a step, as the released code fits (neural_object_fitting@7309348): half-turns for angles.
RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01, "roll": 0.01, "shift": 0.03, "scale": 0.03}
# What is left of them after the last step.
FINAL_RATE_FRACTION = 0.08
BETAS = (0.7, 0.95)
# Of the logarithms of the distance, where there is depth, and of a focal length that is not known.
DISTANCE_RATE, FOCAL_RATE = 0.01, 0.06
# Of depth, and the difference from which on pixels lose weight, in box diagonals of the category's mean.
DEPTH_WEIGHT, DEPTH_SCALE = 0.5, 0.05


def default_energies() -> dict[str, tuple[Energy, float]]:
    """What compares drawing and photo unless said otherwise, by name and with weights."""
    return {
        "perceptual": (Perceptual(EfficientNetLite0()), 1.0),
        "ssim": (SSIM(), 2.0),
        "silhouette": (Silhouette(), 5.0),
    }


def default_parts(
    generator: Generator,
    encoder: Encoder,
    pose_head: PoseNetwork | None,
    card: Card,
    depth: bool,
    lens_known: bool,
    energies: Mapping[str, tuple[Energy, float]],
) -> tuple[dict[str, Energy | Prior], dict[str, float], list[Initializer], dict[str, float]]:
    """Energies with priors, their weights, initializers and rates of `kfit.pose.CategoryModel.pipeline`."""
    parts: dict[str, Energy | Prior] = {name: energy for name, (energy, _) in energies.items()}
    parts["prior"] = CodePrior()
    fixed: dict[str, float | list[float]] = {"shift": 0.0, "scale": 1.0}
    initializers: list[Initializer] = [
        PosePosterior(pose_head) if pose_head else SphereGrid(elevation_deg=(0.0, 60.0)),
        EncoderPosterior(encoder),
        Constant(fixed if pose_head else fixed | {"roll": 0.0}),
    ]
    weights = {name: weight for name, (_, weight) in energies.items()}
    weights["prior"] = 0.02
    rates = dict(RATES)
    if "focal" in generator.variables:
        initializers.append(FromCamera())
        rates["focal"] = 0.0 if lens_known else FOCAL_RATE
        if not lens_known:
            parts["lens"], weights["lens"] = LensPrior(card.mean_diagonal, card.unit_fraction), LENS_WEIGHT
    if pose_head is not None:
        parts["pose"], weights["pose"] = PosePrior(pose_head), card.pose_weight
    if depth:
        parts["depth"], weights["depth"] = Depth(GemanMcClure(DEPTH_SCALE * card.mean_diagonal)), DEPTH_WEIGHT
        initializers = [FromDepth(generator, initializers)]
        rates["distance"] = DISTANCE_RATE
    return parts, weights, initializers, rates
