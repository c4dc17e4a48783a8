"""A mug's quick fit, for tests of what reports show."""

from functools import cache

import kfit
from kfit.callbacks import Pruning
from kfit.data import build, pose_view
from kfit.pose import PoseResult

STEPS, STARTS, PRUNED_AT, KEPT = 5, 4, 2, 2


@cache
def fitted_mug(category: str = "mug") -> PoseResult:
    mesh, light = build(category, 7)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    model = kfit.load(category)
    pipeline = model.pipeline(STARTS, STEPS, [Pruning({PRUNED_AT: KEPT})])
    return model.pose(view.image, mask=view.mask, pipeline=pipeline)
