"""What a fit uses unless said otherwise: rates, weights and energies."""

from __future__ import annotations

from collections.abc import Mapping

from kfit.core import Encoder, Energy, Initializer, Prior, Schedule
from kfit.energies import SSIM, CodePrior, Depth, Perceptual, PosePrior, Silhouette
from kfit.features import EfficientNetLite0
from kfit.geometry import PoseNetwork
from kfit.initializers import Constant, EncoderPosterior, FromDepth, PosePosterior, SphereGrid
from kfit.pose.card import Card

# Raw units a step, as the released code fits (neural_object_fitting@7309348): half-turns for angles.
RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01, "roll": 0.01, "shift": 0.03, "scale": 0.03}
# What is left of them after the last step.
FINAL_RATE_FRACTION = 0.08
BETAS = (0.7, 0.95)
# Where depth is seen: distance in logarithms, the focal length known.
DEPTH_RATES = {"distance": 0.01, "focal": 0.0}
# Where several cameras see it: the size in logarithms.
VIEWS_RATE = 0.03
DEPTH_WEIGHT = 4.0  # of a box diagonal


def default_energies() -> dict[str, tuple[Energy, float]]:
    """What compares drawing and photo unless said otherwise, by name and with weights."""
    return {
        "perceptual": (Perceptual(EfficientNetLite0()), 1.0),
        "ssim": (SSIM(), 2.0),
        "silhouette": (Silhouette(), 5.0),
    }


def default_parts(
    encoder: Encoder,
    pose_head: PoseNetwork | None,
    card: Card,
    depth: bool,
    energies: Mapping[str, tuple[Energy, float]],
) -> tuple[dict[str, Energy | Prior], dict[str, float | Schedule], list[Initializer], dict[str, float]]:
    """Energies with priors, their weights, initializers and rates of `kfit.pose.CategoryModel.pipeline`."""
    parts: dict[str, Energy | Prior] = {name: energy for name, (energy, _) in energies.items()}
    parts["prior"] = CodePrior()
    fixed: dict[str, float | list[float]] = {"shift": 0.0, "scale": 1.0}
    initializers: list[Initializer] = [
        PosePosterior(pose_head) if pose_head else SphereGrid(elevation_deg=(0.0, 60.0)),
        EncoderPosterior(encoder),
        Constant(fixed if pose_head else fixed | {"roll": 0.0}),
    ]
    weights: dict[str, float | Schedule] = {name: weight for name, (_, weight) in energies.items()}
    weights["prior"] = 0.02
    rates = dict(RATES)
    if pose_head is not None:
        parts["pose"], weights["pose"] = PosePrior(pose_head), card.pose_weight
    if depth:
        parts["depth"], weights["depth"] = Depth(), DEPTH_WEIGHT / card.mean_diagonal
        initializers.append(FromDepth(card.unit_fraction))
        rates |= DEPTH_RATES
    return parts, weights, initializers, rates
