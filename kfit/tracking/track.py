"""Tracking of one object through the frames of a video, faster than fitting each frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kfit.pose.category_model import CategoryModel
from kfit.segmentation import Photo
from kfit.tracking.track_confidence import pose_head_of
from kfit.tracking.tracked_pose import TrackedPose
from kfit.tracking.tracker import Tracker


def track(
    model: CategoryModel,
    frames: Iterable[str | Path | Photo | NDArray[Any]],
    masks: Iterable[NDArray[Any]] | None = None,
    seed: int = 0,
    **first: Any,
) -> Iterator[TrackedPose]:
    """Yield the poses of one object in the frames of a video, one by one.

    The first frame is fitted by `kfit.pose.CategoryModel.pose`. In the others the code is fixed; the pose is the
    likelier one of the extrapolated last pose and of the pose head's prediction for the frame; roll, shift and scale
    then follow by Gauss–Newton on this one drawing. The mask is the argument, else it is segmented around the last
    drawing's silhouette (`kfit.segmentation.mask_near`). If drawing and mask no longer overlap, or the energy has
    doubled, the frame is fitted from scratch in the box where the object is expected.

    Args:
        model: with a pose head.
        frames: as `kfit.pose.CategoryModel.pose` takes photos, all of one size and camera.
        masks: (H, W) of every frame, above one half on the object.
        seed: determines the random numbers.
        first: other arguments of `kfit.pose.CategoryModel.pose` for the first frame: ``mask``, ``box``, ``intrinsics``,
            ``segmenter``; ``intrinsics`` hold for all frames.

    Raises:
        ValueError: if the model has no pose head, or a frame or mask cannot be used.

    Example:
        >>> import numpy as np, kfit
        >>> image, mask = np.ones((96, 96, 3)), np.zeros((96, 96))
        >>> image[20:80, 30:70], mask[20:80, 30:70] = (0.7, 0.2, 0.1), 1
        >>> model = kfit.load("mug")
        >>> from kfit.tracking import track
        >>> short = model.pipeline(num_starts=1, num_steps=1)  # for this example
        >>> poses = list(track(model, [image, image], masks=[mask, mask], pipeline=short))
        >>> [pose.anew for pose in poses]
        [True, False]
    """
    pose_head_of(model)  # refused before the first frame is fitted
    remaining = iter(masks) if masks is not None else None
    tracker: Tracker | None = None
    for frame in frames:
        mask = None if remaining is None else next(remaining, None)
        if remaining is not None and mask is None:
            raise ValueError("masks must hold one for each frame, got fewer")
        if tracker is None:
            result = model.pose(frame, **{**first, **({} if mask is None else {"mask": mask})}, seed=seed)
            tracker = Tracker(model, result, seed)
            yield tracker.last
        else:
            yield tracker(frame, mask)
