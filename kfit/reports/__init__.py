"""Pictures of results."""

from kfit.reports.overlay import draw_frame, draw_overlay
from kfit.reports.video_file import VideoFile

__all__ = ["VideoFile", "draw_frame", "draw_overlay"]
