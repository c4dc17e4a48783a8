"""Pictures of results."""

from kfit.reports.overlay import draw_frame, draw_objects, draw_overlay
from kfit.reports.video_file import VideoFile
from kfit.reports.words import describe

__all__ = ["VideoFile", "describe", "draw_frame", "draw_objects", "draw_overlay"]
