"""What is reported and never minimised."""

from kfit.metrics.pose import rotation_error_deg, summary, translation_error_cm

__all__ = ["rotation_error_deg", "summary", "translation_error_cm"]
