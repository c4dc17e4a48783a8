"""Frames of CAMERA25 and REAL275 as published: colour, depth, coordinates, masks, objects and true poses."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kfit.data.nocs_alignment import align
from kfit.data.nocs_models import NOCSModel, read_meta
from kfit.data.nocs_pickle import load_pickle
from kfit.geometry import CATEGORIES

# Of NOCS's detect_eval.py (hughw19/NOCS_CVPR2019@5ff4f758).
CAMERA_INTRINSICS = ((577.5, 0.0, 319.5), (0.0, 577.5, 239.5), (0.0, 0.0, 1.0))
REAL_INTRINSICS = ((591.0125, 0.0, 322.525), (0.0, 590.16775, 244.11084), (0.0, 0.0, 1.0))

_NAMES = {category.nocs_id: name for name, category in CATEGORIES.items()}
_NO_DEPTH = 32001  # what CAMERA writes where its renderer drew nothing
_BACKGROUND = 255
_LARGEST_SIDE = 10_000


@dataclass(frozen=True)
class NOCSObject:
    """An object in a frame.

    Attributes:
        instance: its number in the mask.
        category: as `kfit.geometry.CATEGORIES` spells it.
        model: its mesh and box.
        mask: (H, W).
        box: (4,) of the mask: top, left, bottom, right, the latter two just outside.
        pose: (4, 4) of [s R | t], object to camera in metres and OpenCV axes, s being the box's diagonal; None if
            neither a pickle nor depth and coordinates determine it.
        size: (3,) extents over the diagonal; None if neither a pickle nor a model has them.
        handle_visible: False for a mug whose handle is hidden by the pickle; True if the pickle has no entry.

    Example:
        >>> from kfit.data import NOCSFrames
        >>> frames = NOCSFrames("NOCS", "real_test")  # doctest: +SKIP
        >>> frame = frames[0]  # doctest: +SKIP
        >>> [(found.category, found.pose) for found in frame.objects]  # doctest: +SKIP
    """

    instance: int
    category: str
    model: NOCSModel
    mask: NDArray[np.bool_] = field(repr=False)
    box: NDArray[np.int32]
    pose: NDArray[np.float64] | None = None
    size: NDArray[np.float64] | None = None
    handle_visible: bool = True


@dataclass(frozen=True)
class NOCSFrame:
    """One picture with its depth, coordinates and objects.

    Attributes:
        path: the files' common beginning, ``…/scene_1/0000``.
        image: (H, W, 3) uint8 RGB.
        depth: (H, W) float32 in metres, 0 where unknown.
        coordinates: (H, W, 3) float32 of the object's surface over its box's diagonal, in [−0.5, 0.5]; without meaning
            outside the masks.
        intrinsics: (3, 3).
        objects: in the order of their numbers.

    Example:
        >>> from kfit.data import NOCSFrames
        >>> frames = NOCSFrames("NOCS", "real_test")  # doctest: +SKIP
        >>> frame = frames[0]  # doctest: +SKIP
        >>> [(found.category, found.pose) for found in frame.objects]  # doctest: +SKIP
    """

    path: Path
    image: NDArray[np.uint8] = field(repr=False)
    depth: NDArray[np.floating] = field(repr=False)
    coordinates: NDArray[np.floating] = field(repr=False)
    intrinsics: NDArray[np.float64]
    objects: tuple[NOCSObject, ...]


def read_frame(
    path: str | Path,
    intrinsics: NDArray[np.float64],
    full_depth: str | Path | None = None,
    truth: str | Path | None = None,
    models: str | Path | None = None,
) -> NOCSFrame:
    """Read a frame; `NOCSFrames` finds the files of a whole dataset.

    Args:
        path: the files' common beginning, ``…/scene_1/0000`` for ``0000_color.png`` and so on.
        intrinsics: (3, 3).
        full_depth: CAMERA's composed depth, which includes the table; else the frame's own, of the objects alone.
        truth: NOCS's pickle of true poses. The poses of missing objects are estimated by `align`.
        models: folder of the object models of this part of the data, ``…/obj_models/real_test``.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if one cannot be read or does not match the others.

    Example:
        >>> import numpy as np
        >>> from kfit.data import read_frame
        >>> read_frame("real/test/scene_1/0000", np.eye(3))
        Traceback (most recent call last):
        FileNotFoundError: ...
    """
    path = Path(path)
    color = read_picture(Path(f"{path}_color.png"))[..., 2::-1]
    # The three channels of a mask are equal in REAL275; CAMERA has the number in red alone.
    numbers = _same_size(read_picture(Path(f"{path}_mask.png")), color, path)[..., 2]
    stored = _same_size(read_picture(Path(f"{path}_coord.png")), color, path)[..., 2::-1].astype(np.float32) / 255
    # NOCS stores z mirrored.
    stored[..., 2] = 1 - stored[..., 2]
    depth = _same_size(read_depth(full_depth if full_depth is not None else f"{path}_depth.png"), color, path)
    known = _known(truth)
    points = _points(depth, intrinsics)
    objects = []
    for instance, (class_id, model) in sorted(read_meta(Path(f"{path}_meta.txt"), models).items()):
        mask = numbers == instance
        if class_id not in _NAMES or instance == _BACKGROUND or not mask.any():
            continue
        box = _box(mask)
        pose, size, visible = _match(known, class_id, box)
        if pose is None:
            depth_on_object = mask & (depth > 0)
            try:
                pose = align(stored[depth_on_object] - 0.5, points[depth_on_object])
            except ValueError:
                pose = None
        size = model.size if size is None else size
        objects.append(NOCSObject(instance, _NAMES[class_id], model, mask, box, pose, size, visible))
    return NOCSFrame(path, np.ascontiguousarray(color), depth, stored - 0.5, intrinsics, tuple(objects))


def read_depth(path: str | Path) -> NDArray[np.floating]:
    """Read depth (H, W) in metres, 0 where unknown, of REAL275's and CAMERA's composed depths and of CAMERA's own.

    The former are 16-bit millimetres; the latter 8-bit colours of 256 · green + red millimetres.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is neither.
    """
    stored = read_picture(Path(path), cv2.IMREAD_UNCHANGED)
    if stored.ndim == 2 and stored.dtype == np.uint16:
        millimetres = stored
    elif stored.ndim == 3 and stored.dtype == np.uint8 and stored.shape[2] >= 3:
        millimetres = stored[..., 1].astype(np.uint16) * 256 + stored[..., 2]
    else:
        raise ValueError(f"{path} is no depth: 16-bit grey or 8-bit colours are, it has {stored.shape} {stored.dtype}")
    return np.where(millimetres == _NO_DEPTH, 0, millimetres).astype(np.float32) / 1000


def read_picture(path: Path, how: int = cv2.IMREAD_COLOR) -> NDArray[Any]:
    """Read a PNG of at most 10,000 pixels a side.

    Raises:
        FileNotFoundError, ValueError: if there is none, or it cannot be read.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's own warning of large pictures
            with Image.open(path, formats=["PNG"]) as head:  # reads the head alone
                small = max(head.size) <= _LARGEST_SIDE
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        small = False
    picture: NDArray[Any] | None = cv2.imread(str(path), how) if small else None
    if picture is None:
        raise ValueError(f"{path} is not an image that can be read")
    return picture


def _same_size(picture: NDArray[Any], color: NDArray[Any], path: Path) -> NDArray[Any]:
    if picture.shape[:2] != color.shape[:2]:
        raise ValueError(f"all pictures of {path} must have one size, got {picture.shape[:2]} and {color.shape[:2]}")
    return picture


def _points(depth: NDArray[np.floating], intrinsics: NDArray[np.float64]) -> NDArray[np.float64]:
    """Camera points (H, W, 3) of all pixels."""
    rows, columns = np.indices(depth.shape)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(intrinsics).T
    points: NDArray[np.float64] = rays * depth[..., None]
    return points


def _box(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return np.array([rows[0], columns[0], rows[-1] + 1, columns[-1] + 1], np.int32)


def _known(truth: str | Path | None) -> Mapping[str, Any] | None:
    """Contents of a pickle of true poses."""
    if truth is None:
        return None
    known = load_pickle(truth)
    needed = ("gt_class_ids", "gt_bboxes", "gt_RTs", "gt_scales")
    if not isinstance(known, dict) or any(known.get(key) is None for key in needed):
        raise ValueError(f"{truth} must hold {', '.join(needed)}")
    if len({len(known[key]) for key in needed}) > 1:
        raise ValueError(
            f"{truth} must have equally many entries of each key, got {[len(known[key]) for key in needed]}"
        )
    return known


def _match(
    known: Mapping[str, Any] | None, class_id: int, box: NDArray[np.int32]
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, bool]:
    """Return pose, size and handle visibility of the object with this class and box, within five pixels in total."""
    if known is None:
        return None, None, True
    visible = next((known[key] for key in ("gt_handle_visibility", "handle_visibility") if key in known), None)
    for row, (other, place) in enumerate(zip(known["gt_class_ids"], known["gt_bboxes"], strict=True)):
        if int(other) == class_id and np.abs(np.asarray(place) - box).sum() <= 5:
            pose, size = (np.asarray(known[key][row], np.float64) for key in ("gt_RTs", "gt_scales"))
            return pose, size, visible is None or bool(visible[row])
    return None, None, True
