"""Summaries of fits of unseen views: medians and fractions, ambiguous answers, and cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from kfit.bench.held_out_views import RIGHT_DEG, HeldOutViews, called_ambiguous, rotation_errors, translation_errors
from kfit.core import FitResult
from kfit.fitting.pipeline import FitPipeline
from kfit.metrics import summary
from kfit.pose.category_model import CategoryModel


@dataclass(frozen=True)
class PoseErrors:
    """Fits of views, and their errors.

    Attributes:
        rotation_deg: (N,) as `rotation_errors` measures.
        translation_cm: (N,).
        visible: (N,) False where a mug's handle is hidden.
        ambiguous: (N,) whether the answer is called ambiguous.
        results: the fits, in batches.
        seconds: a view.
    """

    rotation_deg: Tensor
    translation_cm: Tensor
    visible: Tensor
    ambiguous: Tensor
    results: list[FitResult]
    seconds: float

    def figures(self) -> dict[str, Any]:
        """Numbers, medians and shares for all views and, where some hide a handle, for those that show it; how many of
        the right, the wrong and the undecidable answers are called ambiguous; and what it cost."""
        right = self.visible & (self.rotation_deg < RIGHT_DEG)
        groups = {
            f"answers within {RIGHT_DEG:g}°": right,
            "other answers": self.visible & ~right,
            "hidden handles": ~self.visible,
        }
        views = {"all views": torch.ones_like(self.visible)}
        if not bool(self.visible.all()) and bool(self.visible.any()):
            views["views that show the handle"] = self.visible
        drawn = sum(result.num_evaluations for result in self.results) / len(self.visible)
        return {
            **{name: {"number": int(rows.sum()), **summary(self.rotation_deg[rows])} for name, rows in views.items()},
            "median translation error in cm": float(self.translation_cm.nanmedian()),
            "called ambiguous": {
                name: {"number": int(rows.sum()), "called ambiguous": float(self.ambiguous[rows].double().mean())}
                for name, rows in groups.items()
                if bool(rows.any())
            },
            "pictures a view": drawn,
            "seconds a view": self.seconds,
        }


def measure(
    model: CategoryModel,
    views: HeldOutViews,
    pipeline: FitPipeline,
    on_batch: Callable[[int], None] = lambda done: None,
) -> PoseErrors:
    """Fit all views as `rotation_errors` does, and evaluate the answers."""
    begun = time.perf_counter()
    errors, results = rotation_errors(model, views, pipeline, on_batch=on_batch)
    spent = (time.perf_counter() - begun) / len(errors)
    away, ambiguous = 100 * translation_errors(model, views, results), called_ambiguous(model, views, results)
    return PoseErrors(errors, away, views.visible, ambiguous, results, spent)
