"""How generators, pose heads and the networks that kfit is compared with are trained."""

from kfit.training.atomic_checkpoints import AtomicCheckpoints
from kfit.training.conditional_vae import ConditionalVAE
from kfit.training.coordinate_training import CoordinateTraining
from kfit.training.orientation_training import OrientationTraining
from kfit.training.photometric_augmentation import PhotometricAugmentation
from kfit.training.picture_grid import PictureGrid
from kfit.training.pose_training import PoseTraining
from kfit.training.provenance import Provenance
from kfit.training.random_corruption import RandomCorruption
from kfit.training.random_crop import RandomCrop
from kfit.training.random_recolor import RandomRecolor
from kfit.training.random_similarity import RandomSimilarity
from kfit.training.refiner_training import RefinerTraining

__all__ = [
    "AtomicCheckpoints",
    "ConditionalVAE",
    "CoordinateTraining",
    "OrientationTraining",
    "PhotometricAugmentation",
    "PictureGrid",
    "PoseTraining",
    "Provenance",
    "RandomCorruption",
    "RandomCrop",
    "RandomRecolor",
    "RandomSimilarity",
    "RefinerTraining",
]
