"""Pictures of results."""

from kfit.reports.describe import describe
from kfit.reports.overlay import draw_overlay

__all__ = ["describe", "draw_overlay"]
