"""Following one object through the frames of a video, faster than frames are fitted one by one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kfit.pose.category_model import CategoryModel
from kfit.segmentation import Photo
from kfit.tracking.tracked_pose import TrackedPose
from kfit.tracking.tracker import Tracker


def track(
    model: CategoryModel,
    frames: Iterable[str | Path | Photo | NDArray[Any]],
    masks: Iterable[NDArray[Any]] | None = None,
    seed: int = 0,
    **first: Any,
) -> Iterator[TrackedPose]:
    """Poses of one object in the frames of a video, one after another.

    The first frame is fitted by `CategoryModel.pose`. In the others the code is held; the pose is the more likely of
    the last one, moved on as it moved before, and of what the pose head reads off the frame; roll, shift and scale
    then follow by Gauss–Newton on the one drawing. The mask is the one given, else what stands out about the last
    drawing's silhouette (`kfit.segmentation.mask_near`). Where drawing and mask no longer overlap, or the energy has
    doubled, the frame is fitted from nothing in the box where the object should be.

    Args:
        model: with a pose head.
        frames: as `CategoryModel.pose` takes photos, all of one size and camera.
        masks: (H, W) of every frame, above one half on the object.
        seed: decides the random numbers.
        first: what else `CategoryModel.pose` is to know of the first frame: ``mask``, ``box``, ``intrinsics``,
            ``segmenter``; ``intrinsics`` hold for all.

    Raises:
        ValueError: for a model without a pose head, or frames or masks that cannot be used.
    """
    given = iter(masks) if masks is not None else None
    tracker: Tracker | None = None
    for frame in frames:
        mask = None if given is None else next(given, None)
        if given is not None and mask is None:
            raise ValueError("masks: there are fewer than frames")
        if tracker is None:
            result = model.pose(frame, **{**first, **({} if mask is None else {"mask": mask})}, seed=seed)
            tracker = Tracker(model, result, seed)
            yield tracker.last
        else:
            yield tracker(frame, mask)
