"""Models of categories: files, loading, and the way from a photo to a pose."""

from kfit.models.files import read_checkpoint, read_model, write_model
from kfit.models.load import bundled, load
from kfit.models.released import load_released, released_values
from kfit.pose.card import Card
from kfit.pose.category_model import CategoryModel
from kfit.pose.result import Alternative, PoseResult
from kfit.tracking.track import track
from kfit.tracking.tracked_pose import TrackedPose
from kfit.tracking.tracker import Tracker

__all__ = [
    "Alternative",
    "Card",
    "CategoryModel",
    "PoseResult",
    "TrackedPose",
    "Tracker",
    "bundled",
    "follow",
    "load",
    "load_released",
    "read_checkpoint",
    "read_model",
    "released_values",
    "write_model",
]
