"""The poses of all objects in a photo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Callback
from kfit.fitting.pipeline import FitPipeline
from kfit.models.load import load
from kfit.pose import CategoryModel, PoseResult
from kfit.pose.inputs import as_photo
from kfit.pose.object_finder import FoundObject
from kfit.pose.targets import find_targets, is_unexplained, smaller_targets, with_score
from kfit.segmentation import Box, Photo, Segmenter, load_segmenter, read_photo


def find_poses(
    image: str | Path | Photo | NDArray[Any],
    category: str | CategoryModel | None = None,
    *,
    mask: NDArray[Any] | None = None,
    box: Box | None = None,
    intrinsics: NDArray[Any] | Tensor | None = None,
    depth: NDArray[Any] | None = None,
    ignore: NDArray[Any] | None = None,
    segmenter: str | Path | Segmenter | None = None,
    seed: int = 0,
) -> list[PoseResult]:
    """Find the poses of all bottles, bowls, cameras, cans, laptops and mugs in a photo.

    Each answer has its category and, as ``category_score``, the probability of that category by the object's
    appearance.

    Args:
        image: path of a photo, the result of `kfit.segmentation.read_photo`, or (H, W, 3) RGB: uint8, or floating
            point in [0, 1].
        category: limits the search to one category, or to that of your own model.
        mask: (H, W), above one half of its full scale on one object.
        box: left, top, width, height in pixels around one object.
        intrinsics: (3, 3) of the camera; by the file's EXIF tags, or a view of 60°, by default.
        depth: (H, W) in metres along the camera's axis; values that are not finite and above 0 are unknown.
        ignore: (H, W), above one half of its full scale where pixels do not count, as something else hides an object.
        segmenter: your own network for the masks, as an ONNX file or a `kfit.segmentation.Segmenter`.
        seed: determines the random numbers.

    Returns:
        One answer for each object, by decreasing score; an empty list if no object is found.

    Raises:
        FileNotFoundError, ValueError: if a photo, mask, box, intrinsics or depth cannot be used, in one sentence.

    Example:
        >>> import kfit
        >>> from skimage.data import coffee
        >>> [cup] = kfit.find_poses(coffee())
        >>> cup.category
        'mug'
    """
    if isinstance(image, Photo):
        photo = image
    else:
        photo = read_photo(image) if isinstance(image, str | Path) else Photo(as_photo(image))
    model = category if isinstance(category, CategoryModel) else None
    name = category if not isinstance(category, CategoryModel) else category.card.category
    known = load_segmenter(segmenter) if isinstance(segmenter, str | Path) else segmenter
    targets = find_targets(photo, name, mask, box, known)
    return [
        pose_of(model or load(target.category), photo, target, intrinsics, depth, seed, ignore=ignore)
        for target in targets
    ]


def pose_of(
    model: CategoryModel,
    photo: Photo,
    target: FoundObject,
    intrinsics: NDArray[Any] | Tensor | None = None,
    depth: NDArray[Any] | None = None,
    seed: int = 0,
    pipeline: FitPipeline | None = None,
    callbacks: Sequence[Callback] = (),
    ignore: NDArray[Any] | None = None,
) -> PoseResult:
    """The pose of one object that was found; arguments as those of `kfit.pose.CategoryModel.pose`.

    If the drawing explains the picture poorly, the mask may hold a part of something else. Then the fit is repeated
    without each of the parts that stick out of the object; where the drawing explains what is left, that is the answer.
    Callbacks watch the first fit only.
    """

    def fitted(segmenter: Segmenter, callbacks: Sequence[Callback] = ()) -> PoseResult:
        return model.pose(
            photo,
            intrinsics=intrinsics,
            depth=depth,
            ignore=ignore,
            segmenter=segmenter,
            seed=seed,
            pipeline=pipeline,
            callbacks=callbacks,
        )

    answer = fitted(target, callbacks)
    if not target.chosen and is_unexplained(model.card, answer):
        parts = [fitted(smaller) for smaller in smaller_targets(target)]
        best = min(parts, key=lambda part: part.energy, default=answer)
        answer = answer if is_unexplained(model.card, best) else best
    return with_score(answer, target)


def pose_in_views(
    model: CategoryModel,
    photos: Sequence[Photo],
    targets: Sequence[FoundObject],
    relative_poses: NDArray[Any] | Tensor,
    intrinsics: NDArray[Any] | Tensor | None = None,
    seed: int = 0,
) -> PoseResult:
    """The pose of one object that was found in each of several photos, in the first one's camera."""
    answer = model.pose(photos, intrinsics=intrinsics, relative_poses=relative_poses, segmenter=targets, seed=seed)
    return with_score(answer, min(targets, key=lambda target: 1.0 if target.score is None else target.score))
