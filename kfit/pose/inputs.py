"""Checks of the inputs of a pose: pixels, mask or box, and camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import intrinsics_from_fov
from kfit.pose.check_intrinsics import check_intrinsics
from kfit.segmentation import ObjectMask, Segment, Segmenter, binary_mask, clean_mask

# Field of view along the longer side of an unknown camera: its focal length is 1.2 × that side; see
# `kfit.energies.LensPrior`.
UNKNOWN_FOV_DEG = math.degrees(2 * math.atan(0.5 / 1.2))
# Tolerated rounding of colours outside of [0, 1].
ROUNDING = 1e-3


def as_numbers(name: str, value: Any) -> NDArray[Any]:
    """Convert to an array of numbers or booleans.

    Raises:
        ValueError: naming the argument, if it is anything else.
    """
    try:
        array = np.asarray(value.detach().cpu() if isinstance(value, Tensor) else value)
    except (ValueError, TypeError) as error:  # rows of several lengths
        raise ValueError(f"{name} must be an array of numbers: {error}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of numbers, got {array.dtype} of shape {array.shape}")
    return array


def as_photo(image: NDArray[Any]) -> NDArray[np.float32]:
    """Convert a picture to (H, W, 3) float32 in [0, 1].

    Raises:
        ValueError: if shape, type or range are wrong.
    """
    pixels = as_numbers("image", image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(f"image must have shape (H, W, 3), got {pixels.shape}")
    if pixels.dtype == np.uint8:
        return pixels.astype(np.float32) / np.float32(255)
    if not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"image must be uint8 or floating point in [0, 1], got {pixels.dtype}")
    least, most = pixels.min(), pixels.max()
    if not (np.isfinite(pixels).all() and least >= -ROUNDING and most <= 1 + ROUNDING):
        raise ValueError(f"image must lie in [0, 1], got numbers from {least:g} to {most:g}")
    pixels = pixels.astype(np.float32, copy=False)
    return pixels if least >= 0 and most <= 1 else pixels.clip(0, 1)


def choose_mask(
    pixels: NDArray[np.float32],
    mask: NDArray[Any] | None,
    box: tuple[float, float, float, float] | None,
    alpha: NDArray[np.float32] | None,
    segmenter: Segmenter | None,
    category: str,
) -> Segment:
    """Choose the mask (H, W): ``mask``, else the segmenter's, GrabCut's in the box, ``alpha``, or GrabCut's.

    ``mask`` is thresholded by `kfit.segmentation.binary_mask`; every mask is cleaned by `clean_mask`.

    Raises:
        ValueError: if a mask is combined with a box or segmenter, or one of them cannot be used.
    """
    if mask is not None and not (box is None and segmenter is None):
        other = "segmenter" if box is None else "box"
        raise ValueError(f"mask and {other} were both given; use one of them to select the object")
    if mask is not None:
        values = as_numbers("mask", mask)
        if values.shape != pixels.shape[:2]:
            raise ValueError(f"mask must have the photo's shape {pixels.shape[:2]}, got {values.shape}")
        there = binary_mask(values)
        if not there.any():
            raise ValueError("mask is empty: none of its pixels is above one half")
        return clean_mask(there)
    if alpha is not None and box is None and segmenter is None:
        return clean_mask(alpha)
    if box is not None:
        values = as_numbers("box", box)
        if values.shape != (4,):
            raise ValueError(f"box must be left, top, width and height, got {values.tolist()}")
        left, top, width, height = values.astype(float).tolist()
        box = (left, top, width, height)
    if not (segmenter is None or callable(segmenter)):
        raise ValueError(f"segmenter must be an ONNX file or a Segmenter, got {type(segmenter).__name__}")
    found = (segmenter or ObjectMask())(pixels, category, box)
    clean = clean_mask(found.mask)
    return Segment(clean.mask, found.notes + clean.notes, found.warnings + clean.warnings)


def as_ignored(ignore: NDArray[Any], mask: NDArray[Any]) -> NDArray[np.float32]:
    """Return where pixels do not count, (H, W) of 0 and 1.

    Raises:
        ValueError: if ``ignore`` has not the shape of the mask (H, W), or covers all of the object.
    """
    values = as_numbers("ignore", ignore)
    if values.shape != mask.shape:
        raise ValueError(f"ignore must have the photo's shape {mask.shape}, got {values.shape}")
    hidden = binary_mask(values).astype(np.float32)
    if not (mask * (1 - hidden) > 0.5).any():
        raise ValueError("ignore covers all of the object: nothing is left to fit")
    return hidden


def as_depth(depth: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Convert a depth map to (H, W) float32.

    Raises:
        ValueError: if it is not an array of numbers, or differs from the photo's shape.
    """
    with np.errstate(over="ignore"):  # overflow gives infinity, which is unknown depth
        values = as_numbers("depth", depth).astype(np.float32)
    if values.shape != shape:
        raise ValueError(f"depth must have the photo's shape {shape}, got {values.shape}")
    return values


def choose_camera(
    pixels: NDArray[np.float32],
    intrinsics: NDArray[Any] | Tensor | None,
    known: Tensor | None,
    notes: list[str],
    warnings: list[str],
) -> tuple[Tensor, str]:
    """Return intrinsics (3, 3) and their source: "given", "EXIF" (``known``) or "estimated".

    Raises:
        ValueError: if ``intrinsics`` are not those of a camera, or cannot belong to this photo.
    """
    height, width = pixels.shape[:2]
    if intrinsics is not None:
        matrix = torch.from_numpy(as_numbers("intrinsics", intrinsics).astype(np.float64))
        if matrix.shape != (3, 3) or not bool(torch.isfinite(matrix).all()) or min(matrix[0, 0], matrix[1, 1]) <= 0:
            raise ValueError(f"intrinsics must be (3, 3) with focal lengths above 0, got {matrix.tolist()}")
        if matrix[1, 0] != 0 or matrix[2].tolist() != [0, 0, 1]:
            raise ValueError(f"intrinsics must have the rows (f, s, x), (0, f, y) and (0, 0, 1), got {matrix.tolist()}")
        check_intrinsics(matrix, width, height, notes, warnings)
        return matrix, "given"
    if known is not None:
        return known, "EXIF"
    return intrinsics_from_fov(width, height, UNKNOWN_FOV_DEG), "estimated"
