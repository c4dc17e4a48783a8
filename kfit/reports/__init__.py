"""Pictures of results."""

from kfit.reports.overlay import draw_overlay

__all__ = ["draw_overlay"]
