"""How generators, pose heads and the networks that kfit is compared with are trained."""

from kfit.training.conditional_vae import ConditionalVAE
from kfit.training.coordinate_training import CoordinateTraining
from kfit.training.disturb import Disturb
from kfit.training.jitter import Jitter
from kfit.training.orientation_training import OrientationTraining
from kfit.training.photograph import Photograph
from kfit.training.picture_grid import PictureGrid
from kfit.training.pose_training import PoseTraining
from kfit.training.recolor import Recolor
from kfit.training.whole_checkpoints import WholeCheckpoints

__all__ = [
    "ConditionalVAE",
    "CoordinateTraining",
    "Disturb",
    "Jitter",
    "OrientationTraining",
    "Photograph",
    "PictureGrid",
    "PoseTraining",
    "Recolor",
    "WholeCheckpoints",
]
