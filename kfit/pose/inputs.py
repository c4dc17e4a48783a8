"""What a user may give beside a photo, checked: pixels, mask or box, and camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import intrinsics_from_fov
from kfit.segmentation import GrabCut, Segmenter

# Focal lengths over the photo's longer side: half of that sees 157° or more along it, more than any lens that draws
# straight lines as straight (the widest see some 130°), the other is the length of a telescope (0.06°).
LEAST_FOCAL, MOST_FOCAL = 0.1, 1000.0


def as_numbers(name: str, value: Any) -> NDArray[Any]:
    """An array of numbers or booleans.

    Raises:
        ValueError: for anything else, by its name.
    """
    try:
        array = np.asarray(value.detach().cpu() if isinstance(value, Tensor) else value)
    except (ValueError, TypeError) as error:  # rows of several lengths
        raise ValueError(f"{name} must be an array of numbers: {error}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of numbers, got {array.dtype} of shape {array.shape}")
    return array


def as_photo(image: NDArray[Any]) -> NDArray[np.float32]:
    """The picture as (H, W, 3) float32 in [0, 1].

    Raises:
        ValueError: for another shape, type or range.
    """
    pixels = as_numbers("image", image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(f"image must have shape (H, W, 3), got {pixels.shape}")
    if pixels.dtype == np.uint8:
        return pixels.astype(np.float32) / np.float32(255)
    if not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"image must be uint8 or floating point in [0, 1], got {pixels.dtype}")
    if not (np.isfinite(pixels).all() and pixels.min() >= 0 and pixels.max() <= 1):
        raise ValueError(f"image must lie in [0, 1], got numbers from {pixels.min():g} to {pixels.max():g}")
    return pixels.astype(np.float32, copy=False)


def choose_mask(
    pixels: NDArray[np.float32],
    mask: NDArray[Any] | None,
    box: tuple[float, float, float, float] | None,
    alpha: NDArray[np.float32] | None,
    segmenter: Segmenter | None,
    category: str,
    notes: list[str],
) -> NDArray[np.float32]:
    """The mask (H, W): the one given, else the segmenter's, else GrabCut's in the box, else ``alpha``, else GrabCut's.

    Raises:
        ValueError: if a mask and something else that tells the object are given, or one of them cannot be used.
    """
    if mask is not None and not (box is None and segmenter is None):
        other = "segmenter" if box is None else "box"
        raise ValueError(f"mask and {other} were both given; the object is told by one of them")
    if mask is not None:
        given = as_numbers("mask", mask)
        if given.shape != pixels.shape[:2]:
            raise ValueError(f"mask must have the photo's shape {pixels.shape[:2]}, got {given.shape}")
        if not (given > 0).any():
            raise ValueError("mask is empty: none of its pixels is above 0")
        return (given > 0).astype(np.float32)
    if alpha is not None and box is None and segmenter is None:
        return alpha
    if box is not None:
        given = as_numbers("box", box)
        if given.shape != (4,):
            raise ValueError(f"box must be left, top, width and height, got {given.tolist()}")
        left, top, width, height = given.astype(float).tolist()
        box = (left, top, width, height)
    if not (segmenter is None or callable(segmenter)):
        raise ValueError(f"segmenter must be an ONNX file or a Segmenter, got {type(segmenter).__name__}")
    found = (segmenter or GrabCut())(pixels, category, box)
    notes.extend(found.notes)
    return found.mask


def choose_depth(depth: NDArray[Any], mask: NDArray[np.float32]) -> Tensor:
    """The depth map (H, W) as given, float32.

    Raises:
        ValueError: if it has not the photo's shape, or is known nowhere on the object.
    """
    with np.errstate(over="ignore"):  # what is too far for single precision becomes infinite, which is unknown
        given = torch.as_tensor(as_numbers("depth", depth).astype(np.float32))
    if given.shape != mask.shape:
        raise ValueError(f"depth must have the photo's shape {mask.shape}, got {tuple(given.shape)}")
    if not bool((given.isfinite() & (given > 0))[torch.from_numpy(mask > 0.5)].any()):
        raise ValueError("depth is unknown everywhere on the object: no number there is above 0")
    return given


def choose_camera(
    pixels: NDArray[np.float32], intrinsics: NDArray[Any] | Tensor | None, known: Tensor | None, notes: list[str]
) -> tuple[Tensor, str]:
    """Intrinsics (3, 3) and where they come from: "given", "EXIF" (``known``) or "assumed".

    Raises:
        ValueError: if those given are no camera, or one that sees absurdly much or little of this photo.
    """
    height, width = pixels.shape[:2]
    if intrinsics is not None:
        given = torch.from_numpy(as_numbers("intrinsics", intrinsics).astype(np.float64))
        if given.shape != (3, 3) or not bool(torch.isfinite(given).all()) or min(given[0, 0], given[1, 1]) <= 0:
            raise ValueError(f"intrinsics must be (3, 3) with focal lengths above 0, got {given.tolist()}")
        if given[1, 0] != 0 or given[2].tolist() != [0, 0, 1]:
            raise ValueError(f"intrinsics must have the rows (f, s, x), (0, f, y) and (0, 0, 1), got {given.tolist()}")
        least, most = LEAST_FOCAL * max(width, height), MOST_FOCAL * max(width, height)
        if not all(least <= focal <= most for focal in (given[0, 0], given[1, 1])):
            raise ValueError(
                f"intrinsics of a photo of {width} x {height} must have focal lengths from {least:g} to {most:g} "
                f"pixels, got {given[0, 0]:g} and {given[1, 1]:g}"
            )
        x, y = given[0, 2], given[1, 2]
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            notes.append(
                "the principal point lies outside the photo: are these the intrinsics of a rescaled or cropped picture?"
            )
        return given, "given"
    if known is not None:
        return known, "EXIF"
    notes.append("intrinsics assumed: a camera that sees 60° along the photo's longer side; distance depends on it")
    return intrinsics_from_fov(width, height, 60.0), "assumed"
