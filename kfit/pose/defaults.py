"""Default rates, weights and energies of a fit."""

from __future__ import annotations

from kfit.core import Energy
from kfit.energies import SSIM, Perceptual, Silhouette
from kfit.features import EfficientNetLite0

# Raw units a step, as the released code fits (neural_object_fitting@7309348): half-turns for angles.
RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01, "roll": 0.01, "shift": 0.03, "scale": 0.03}
# Fraction of the rates at the last step.
FINAL_RATE_FRACTION = 0.08
BETAS = (0.7, 0.95)
# Rates of the logarithms of the distance (with depth), of an unknown focal length, and of the size (with several
# cameras).
DISTANCE_RATE, FOCAL_RATE, DIAGONAL_RATE = 0.01, 0.06, 0.03
# Weight of depth, and scale of its robust kernel in mean box diagonals of the category.
DEPTH_WEIGHT, DEPTH_SCALE = 0.5, 0.05


def default_energies() -> dict[str, tuple[Energy, float]]:
    """Return the default energies of drawing and photo, by name and with weights."""
    return {
        "perceptual": (Perceptual(EfficientNetLite0()), 1.0),
        "ssim": (SSIM(), 2.0),
        "silhouette": (Silhouette(), 5.0),
    }
