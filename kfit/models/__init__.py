"""Model files: the bundled ones, reading and writing, and poses with them."""

from kfit.models.find_poses import find_poses
from kfit.models.load import bundled, generator_and_encoder, load
from kfit.models.released import load_released, released_values
from kfit.pose.model_files import read_card, read_checkpoint, read_model, write_model

__all__ = [
    "bundled",
    "find_poses",
    "generator_and_encoder",
    "load",
    "load_released",
    "read_card",
    "read_checkpoint",
    "read_model",
    "released_values",
    "write_model",
]
