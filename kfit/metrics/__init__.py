"""Metrics, which are reported and never minimised."""

from kfit.metrics.average_precision import average_precision
from kfit.metrics.box_iou import BoxIoU, axis_aligned_iou, best_iou, nocs_iou, oriented_iou
from kfit.metrics.nocs_objects import nocs_symmetry, scale_agnostic
from kfit.metrics.nocs_protocol import NOCSScores, evaluate_nocs
from kfit.metrics.pose import (
    rotation_error_deg,
    scale_agnostic_translation_error,
    summary,
    translation_error_cm,
)

__all__ = [
    "BoxIoU",
    "NOCSScores",
    "average_precision",
    "axis_aligned_iou",
    "best_iou",
    "evaluate_nocs",
    "nocs_iou",
    "nocs_symmetry",
    "oriented_iou",
    "rotation_error_deg",
    "scale_agnostic",
    "scale_agnostic_translation_error",
    "summary",
    "translation_error_cm",
]
