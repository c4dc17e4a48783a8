"""Tracking of an object through a video."""

from kfit.tracking.track import track
from kfit.tracking.tracked_pose import TrackedPose
from kfit.tracking.tracker import Tracker

__all__ = ["TrackedPose", "Tracker", "track"]
