"""What a fit uses unless said otherwise: rates, weights and energies."""

from __future__ import annotations

from kfit.core import Energy
from kfit.energies import SSIM, Perceptual, Silhouette
from kfit.features import EfficientNetLite0

# Raw units a step, as the released code fits (neural_object_fitting@7309348): half-turns for angles.
RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01, "roll": 0.01, "shift": 0.03, "scale": 0.03}
# What is left of them after the last step.
CAREFUL = 0.08
BETAS = (0.7, 0.95)
# Where depth is seen: distance in logarithms, the focal length known.
DEPTH_RATES = {"distance": 0.01, "focal": 0.0}
DEPTH_WEIGHT = 4.0  # of a box diagonal


def usual_energies() -> dict[str, tuple[Energy, float]]:
    """What compares drawing and photo unless said otherwise, by name and with weights."""
    return {
        "perceptual": (Perceptual(EfficientNetLite0()), 1.0),
        "ssim": (SSIM(), 2.0),
        "silhouette": (Silhouette(), 5.0),
    }
