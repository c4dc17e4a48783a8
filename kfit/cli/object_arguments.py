"""Arguments of `kfit pose` and `kfit video` about the object and the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jsonargparse import Namespace

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def check_thing(args: Namespace) -> None:
    """Refuse arguments without exactly one of --category and --model."""
    if (args.category is None) == (args.model is None):
        raise ValueError("name the object by either --category NAME or --model FILE.safetensors")
    if args.model is not None and not args.model.endswith(".safetensors"):
        raise ValueError(f"--model must name a .safetensors file, got {args.model}")


def camera_of(args: Namespace) -> NDArray[np.float64] | None:
    """The (3, 3) matrix of --intrinsics, where they are given."""
    import numpy as np

    if args.intrinsics is None:
        return None
    fx, fy, cx, cy = args.intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
