"""What a user may give beside a photo, checked: pixels, mask or box, and camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import intrinsics_from_fov
from kfit.segmentation import mask_from_box


def as_photo(image: NDArray[Any]) -> NDArray[np.float32]:
    """The picture as (H, W, 3) float32 in [0, 1].

    Raises:
        ValueError: for another shape, type or range.
    """
    pixels = np.asarray(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(f"image must have shape (H, W, 3), got {pixels.shape}")
    if pixels.dtype == np.uint8:
        return pixels.astype(np.float32) / np.float32(255)
    if not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"image must be uint8 or floating point in [0, 1], got {pixels.dtype}")
    if not (np.isfinite(pixels).all() and pixels.min() >= 0 and pixels.max() <= 1):
        raise ValueError(f"image must lie in [0, 1], got numbers from {pixels.min():g} to {pixels.max():g}")
    return pixels.astype(np.float32)


def choose_mask(
    pixels: NDArray[np.float32],
    mask: NDArray[Any] | None,
    box: tuple[float, float, float, float] | None,
    alpha: NDArray[np.float32] | None,
    notes: list[str],
) -> NDArray[np.float32]:
    """The mask (H, W): the one given, else GrabCut's in the box, else ``alpha``, else GrabCut's in the whole picture.

    Raises:
        ValueError: if both mask and box are given, or one of them cannot be used.
    """
    if mask is not None and box is not None:
        raise ValueError("mask and box were both given; the object is told by one of them")
    if mask is not None:
        given = np.asarray(mask)
        if given.shape != pixels.shape[:2]:
            raise ValueError(f"mask must have the photo's shape {pixels.shape[:2]}, got {given.shape}")
        if not (given > 0).any():
            raise ValueError("mask is empty: none of its pixels is above 0")
        return (given > 0).astype(np.float32)
    if box is not None:
        return mask_from_box(pixels, box)
    if alpha is not None:
        return alpha
    height, width = pixels.shape[:2]
    notes.append("no mask or box given: the object was taken to be what stands out in the whole picture")
    return mask_from_box(pixels, (0.04 * width, 0.04 * height, 0.92 * width, 0.92 * height))


def choose_camera(
    pixels: NDArray[np.float32], intrinsics: NDArray[Any] | Tensor | None, known: Tensor | None, notes: list[str]
) -> tuple[Tensor, str]:
    """Intrinsics (3, 3) and where they come from: "given", "EXIF" (``known``) or "assumed".

    Raises:
        ValueError: if those given are no camera.
    """
    if intrinsics is not None:
        given = torch.as_tensor(intrinsics, dtype=torch.float64)
        if given.shape != (3, 3) or not bool(torch.isfinite(given).all()) or min(given[0, 0], given[1, 1]) <= 0:
            raise ValueError(f"intrinsics must be (3, 3) with focal lengths above 0, got {given.tolist()}")
        return given, "given"
    if known is not None:
        return known, "EXIF"
    height, width = pixels.shape[:2]
    notes.append("intrinsics assumed: a camera that sees 60° along the photo's longer side; distance depends on it")
    return intrinsics_from_fov(width, height, 60.0), "assumed"
