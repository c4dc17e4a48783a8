"""Pictures of results."""

from kfit.reports.answer_line import describe
from kfit.reports.overlay import draw_frame, draw_objects, draw_overlay
from kfit.reports.video_file import VideoFile

__all__ = ["VideoFile", "describe", "draw_frame", "draw_objects", "draw_overlay"]
