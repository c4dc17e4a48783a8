"""Models of categories: files, loading, and the way from a photo to a pose."""

from kfit.models.card import Card
from kfit.models.category_model import CategoryModel
from kfit.models.files import read_card, read_checkpoint, read_model, write_model
from kfit.models.followed import Followed
from kfit.models.follower import Follower
from kfit.models.following import follow
from kfit.models.load import bundled, load
from kfit.models.pose_result import Alternative, PoseResult
from kfit.models.released import load_released, released_values
from kfit.models.released_model import released_model

__all__ = [
    "Alternative",
    "Card",
    "CategoryModel",
    "Followed",
    "Follower",
    "PoseResult",
    "bundled",
    "follow",
    "load",
    "load_released",
    "read_card",
    "read_checkpoint",
    "read_model",
    "released_model",
    "released_values",
    "write_model",
]
