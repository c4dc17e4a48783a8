"""How generators are trained."""

from kfit.training.conditional_vae import ConditionalVAE
from kfit.training.jitter import Jitter
from kfit.training.picture_grid import PictureGrid

__all__ = ["ConditionalVAE", "Jitter", "PictureGrid"]
