"""One object in several photos, prepared for one fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import Observation
from kfit.core.check import check_shape
from kfit.geometry import Category, Crop, diagonal_at, viewing_ray
from kfit.pose.inputs import as_numbers
from kfit.pose.observed_object import ObservedObject
from kfit.segmentation import Photo, Segmenter, load_segmenter

PhotoLike: TypeAlias = "str | Path | Photo | NDArray[Any]"
Box: TypeAlias = tuple[float, float, float, float]


def are_several(image: PhotoLike | Sequence[PhotoLike]) -> TypeGuard[Sequence[PhotoLike]]:
    """Return whether an argument is a list of photos, rather than one photo given as lists of numbers."""
    return isinstance(image, list | tuple) and not any(isinstance(one, list | tuple | int | float) for one in image)


def observe(
    image: PhotoLike | Sequence[PhotoLike],
    category: Category,
    size: int,
    mask: Any,
    box: Any,
    intrinsics: Any,
    depth: Any,
    ignore: Any,
    relative_poses: Any,
    segmenter: Any,
) -> tuple[ObservedObject, Observation]:
    """The object in a photo, or in several, cut out: the first photo's, and what is fitted.

    Args:
        image, mask, box, intrinsics, depth, ignore, relative_poses, segmenter: as `kfit.pose.CategoryModel.pose` takes
            them.
        category: category of the object.
        size: size of the picture in pixels.

    Raises:
        FileNotFoundError, ValueError: for what cannot be used, in one sentence.
    """
    if are_several(image):
        if depth is not None:
            raise ValueError("depth and several photos were both given; a fit of several photos is of colour alone")
        if ignore is not None:
            raise ValueError("ignore and several photos were both given; it is of one photo")
        return observed_views(image, category, size, mask, box, intrinsics, relative_poses, segmenter)
    if relative_poses is not None:
        raise ValueError("relative_poses were given for one photo; they belong to a list of photos")
    photo: Any = image
    observed = ObservedObject.of(photo, category, size, mask, box, intrinsics, depth, segmenter, ignore)
    return observed, observed.observation


def observed_views(
    images: Sequence[PhotoLike],
    category: Category,
    size: int,
    masks: Any,
    boxes: Any,
    intrinsics: Any,
    relative_poses: Any,
    segmenter: str | Path | Segmenter | Sequence[Segmenter] | None,
) -> tuple[ObservedObject, Observation]:
    """Find the object in each photo; return it in the first photo, and one problem of all views.

    Args:
        images: V photos.
        category: category of the object; segmenters use its name.
        size: size of the pictures in pixels.
        masks, boxes, intrinsics: lists of V, or None; one (3, 3) holds for all.
        relative_poses: (V, 4, 4), from the first camera to each.
        segmenter: as `kfit.pose.CategoryModel.pose` takes it.

    Raises:
        ValueError: if a list has another length, a pose is not a rigid motion, the first is not the identity, or a
            lens is unknown.
    """
    count = len(images)
    if count < 2:
        raise ValueError(f"a list of photos must hold at least 2, got {count}")
    if isinstance(segmenter, str | Path):
        segmenter = load_segmenter(segmenter)
    poses = check_relative_poses(relative_poses, count)
    some_unknown = isinstance(intrinsics, list | tuple) and any(one is None for one in intrinsics)
    for_all = intrinsics is None or (not some_unknown and torch.as_tensor(intrinsics).dim() == 2)
    cameras = [intrinsics] * count if for_all else list(intrinsics)
    segmenters: list[Any] = list(segmenter) if isinstance(segmenter, list | tuple) else [segmenter] * count
    lists = {"mask": masks, "box": boxes, "intrinsics": cameras, "segmenter": segmenters}
    for name, values in lists.items():
        if values is not None and len(values) != count:
            raise ValueError(f"{name} must hold one for each of the {count} photos, got {len(values)}")
    found = [
        ObservedObject.of(
            image,
            category,
            size,
            None if masks is None else masks[number],
            None if boxes is None else boxes[number],
            cameras[number],
            segmenter=segmenters[number],
        )
        for number, image in enumerate(images)
    ]
    if unknown := [str(number) for number, one in enumerate(found, 1) if not one.lens_known]:
        raise ValueError(
            f"the lens of photo {', '.join(unknown)} is unknown: several photos need intrinsics or EXIF tags, "
            "as a longer lens and a smaller object give the same pictures"
        )
    observation = replace(Observation.cat([one.observation for one in found]), trans_cam_ref=poses.float(), views=count)
    others = [f"photo {number + 1}: {note}" for number, one in enumerate(found) if number for note in one.notes]
    return replace(found[0], notes=(*found[0].notes, *others)), observation


def triangulated_diagonal(observation: Observation, unit_fraction: float, mean_diagonal: float) -> float:
    """Triangulate the box diagonal in metres of an object in several crops, from its rays and its size in them.

    The rays' nearest common point is the least-squares solution of Σ_v (I − d_v d_vᵀ)(p − c_v) = 0. It is inaccurate
    for nearly parallel rays, so the result is clipped to 1/3 to 3 × the mean.

    Args:
        observation: one problem of several views, with the crops' cameras.
        unit_fraction: fraction of the crop's width that the bounding sphere's silhouette spans at scale 1.
        mean_diagonal: mean diagonal of the category.
    """
    cameras, poses = observation.field("intrinsics").double(), observation.field("trans_cam_ref").double()
    side = observation.image.shape[-1]
    back = poses[:, :3, :3].mT
    middle = torch.full((len(cameras), 2), (side - 1) / 2, dtype=torch.float64)
    rays = viewing_ray(middle, cameras)
    directions, centres = (back @ rays[..., None]), -back @ poses[:, :3, 3:]
    across = torch.eye(3, dtype=torch.float64) - directions @ directions.mT
    point = torch.linalg.lstsq(across.sum(0), (across @ centres).sum(0)).solution[:, 0]
    crop = Crop(((side - 1) / 2, (side - 1) / 2), float(side), side)
    centred, one = torch.zeros(1, 2).double(), torch.ones(1).double()
    found = float(diagonal_at(point.norm()[None], centred, one, crop, cameras[0], unit_fraction))
    kept: float = min(max(found, mean_diagonal / 3), 3 * mean_diagonal)
    return kept


def check_relative_poses(poses: Any, count: int) -> Tensor:
    """Return poses (V, 4, 4) in double precision, from the first camera to each of V.

    Raises:
        ValueError: if they are not that many rigid motions, the first of which is the identity.
    """
    if poses is None:
        raise ValueError("several photos need relative_poses, (V, 4, 4), from the first camera to each")
    matrices = torch.from_numpy(as_numbers("relative_poses", poses).astype(float))
    check_shape("relative_poses", matrices, (count, 4, 4))
    turns, eye = matrices[:, :3, :3], torch.eye(3, dtype=torch.float64)
    rigid = bool(((turns @ turns.mT - eye).abs() < 1e-3).all()) and bool((torch.linalg.det(turns) > 0).all())
    rigid &= bool(matrices.isfinite().all())
    if not rigid or not bool((matrices[:, 3] == matrices.new_tensor([0.0, 0.0, 0.0, 1.0])).all()):
        raise ValueError(
            "relative_poses must be rigid motions: a rotation, a translation, and a last row of 0, 0, 0, 1"
        )
    if not torch.allclose(matrices[0], torch.eye(4, dtype=torch.float64), atol=1e-6):
        raise ValueError("relative_poses must begin with the identity, the first camera's own")
    return matrices
