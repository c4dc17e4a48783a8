"""How generators and pose heads are trained."""

from kfit.training.conditional_vae import ConditionalVAE
from kfit.training.jitter import Jitter
from kfit.training.picture_grid import PictureGrid
from kfit.training.pose_training import PoseTraining
from kfit.training.recolor import Recolor

__all__ = ["ConditionalVAE", "Jitter", "PictureGrid", "PoseTraining", "Recolor"]
