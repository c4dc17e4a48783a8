"""One object in several photos, for `kfit pose --relative-poses`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jsonargparse import Namespace

from kfit.cli.object_arguments import camera_of
from kfit.runtime.console import log

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kfit.pose import CategoryModel, PoseResult
    from kfit.pose.object_finder import FoundObject
    from kfit.segmentation import Photo

# Bytes; a matrix takes some 300.
LARGEST = 1_000_000


def read_poses(path: str, count: int) -> NDArray[np.float64]:
    """Read the matrices (V, 4, 4) of a JSON file, from the first camera to each of V.

    Raises:
        ValueError: if the file holds anything else, or the matrices are not rigid motions, the first the identity.
    """
    import numpy as np

    from kfit.pose.views import check_relative_poses

    if not Path(path).is_file():
        raise ValueError(f"--relative-poses must name a file, but {path} is none")
    if (size := Path(path).stat().st_size) > LARGEST:
        raise ValueError(f"--relative-poses {path} has {size:,} bytes, more than {LARGEST:,}")
    try:
        poses = np.array(json.loads(Path(path).read_text(encoding="utf-8")), float)
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"--relative-poses {path} holds no JSON list of 4 x 4 matrices: {error}") from None
    try:
        return check_relative_poses(poses, count).numpy()
    except ValueError as error:
        raise ValueError(f"--relative-poses {path}: {error}") from None


def shared_object(found: Sequence[Sequence[FoundObject]], photos: Sequence[str]) -> list[FoundObject]:
    """The one object that several photos show, as it was found in each.

    Args:
        found: objects found in each photo.
        photos: their names.

    Raises:
        ValueError: unless just one category was found exactly once in each photo; objects of one category cannot
            be distinguished.
    """
    from kfit.geometry import CATEGORIES

    once = [name for name in CATEGORIES if all(sum(one.category == name for one in targets) == 1 for targets in found)]
    if len(once) == 1:
        return [next(one for one in targets if one.category == once[0]) for targets in found]
    listed = "; ".join(
        f"{', '.join(one.category for one in targets) or 'nothing'} in {photo}"
        for photo, targets in zip(photos, found, strict=True)
    )
    raise ValueError(
        f"--relative-poses needs one object that each photo shows once, but found were {listed}; --category NAME, or "
        "a --box or --mask for each photo, chooses it"
    )


def answer_views(
    args: Namespace,
    photos: Sequence[str],
    found: Sequence[tuple[Photo, list[FoundObject]]],
    poses: NDArray[np.float64],
    model_of: Callable[[str], CategoryModel],
) -> PoseResult:
    """The pose of the one object that all photos show, with its notes in the log."""
    from kfit.models.find_poses import pose_in_views

    targets = shared_object([targets for _, targets in found], photos)
    for name, target in zip(photos, targets, strict=True):
        log.info("found a %s in %s", target.words, name)
    model, pictures = model_of(targets[0].category), [photo for photo, _ in found]
    result = pose_in_views(model, pictures, targets, poses, camera_of(args), args.seed)
    for note in result.notes:
        log.info("%s", note)
    return result
