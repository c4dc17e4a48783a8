"""Initial values of the variables of a fit."""

from kfit.initializers.constant import Constant
from kfit.initializers.encoder_posterior import EncoderPosterior
from kfit.initializers.from_camera import FromCamera
from kfit.initializers.from_depth import FromDepth
from kfit.initializers.from_mask import FromMask
from kfit.initializers.pose_posterior import PosePosterior
from kfit.initializers.previous import Previous
from kfit.initializers.sphere_grid import SphereGrid
from kfit.initializers.uniform import Uniform

__all__ = [
    "Constant",
    "EncoderPosterior",
    "FromCamera",
    "FromDepth",
    "FromMask",
    "PosePosterior",
    "Previous",
    "SphereGrid",
    "Uniform",
]
