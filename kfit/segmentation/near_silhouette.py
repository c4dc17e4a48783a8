"""The object's mask near its last drawing."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments
from kfit.core.check import check_count
from kfit.geometry import Crop
from kfit.segmentation.largest_part import largest_part

ITERATIONS = 2
# Side of the picture in which the mask is segmented, and its size relative to the crop.
GRID, WIDER = 96, 1.3
INVERSE = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
# A mask of another area than this many times the silhouette's, either way, is of something else.
TIMES = 2.0


def mask_in_photo(
    photo: NDArray[np.float32], silhouette: NDArray[np.float32], crop: Crop, band: float
) -> NDArray[np.float32] | None:
    """Segment around a drawn silhouette in a photo: `mask_near` on a grid of 96 × 96 around the crop.

    Args:
        photo: (H, W, 3), RGB in [0, 1].
        silhouette: (S, S) in the crop's pixels, above 1/2 on the object.
        crop: crop of the silhouette.
        band: on each side of its outline, as a fraction of the grid, which is 4/3 as wide as the crop.

    Returns:
        (H, W) in [0, 1], above 1/2 on the object; None if no similar object is found.
    """
    check_arguments(mask_in_photo, locals(), band=(0, 1))
    wide = replace(crop, side=WIDER * crop.side, size=GRID)
    to_photo = wide.crop_to_image.numpy()[:2]
    region = cv2.warpAffine(photo, to_photo, (GRID, GRID), flags=INVERSE, borderMode=cv2.BORDER_REPLICATE)
    from_drawing = (crop.image_to_crop @ wide.crop_to_image).numpy()[:2]
    drawn = cv2.warpAffine(silhouette, from_drawing, (GRID, GRID), flags=INVERSE)
    found = mask_near(region, drawn, round(band * GRID))
    if found is None:
        return None
    size = (photo.shape[1], photo.shape[0])
    mask: NDArray[np.float32] = cv2.warpAffine(found.astype(np.float32), to_photo, size, flags=cv2.INTER_LINEAR)
    return mask if (mask > 0.5).any() else None


def mask_near(image: NDArray[np.float32], silhouette: NDArray[np.float32], band: int) -> NDArray[np.uint8] | None:
    """Run GrabCut within a band around the outline of a silhouette.

    Pixels farther inside are object, pixels farther outside are background, and their colours decide in between
    (Rother, Kolmogorov, Blake 2004). The largest connected part is kept.

    Args:
        image: (H, W, 3), RGB in [0, 1].
        silhouette: (H, W), above 1/2 on the drawn object.
        band: pixels on each side of the outline.

    Returns:
        (H, W) of 0 and 1; None if no similar object is found.
    """
    check_count("band", band, 0, max(image.shape))
    drawn = (silhouette > 0.5).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
    grown, core = cv2.dilate(drawn, disc), cv2.erode(drawn, disc)
    # GrabCut needs as many colours of each as its mixtures have parts.
    if min(int(drawn.sum()), int((grown == 0).sum())) < 8:
        return None
    labels = np.where(grown > 0, cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    labels[drawn > 0] = cv2.GC_PR_FGD
    labels[core > 0] = cv2.GC_FGD
    cv2.setRNGSeed(0)
    mixtures = np.zeros((1, 65)), np.zeros((1, 65))
    pixels = np.round(np.ascontiguousarray(image) * 255).astype(np.uint8)
    cv2.grabCut(pixels, labels, None, *mixtures, ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    if not found.any():
        return None
    part = largest_part(found)
    times = float(part.sum() / drawn.sum())
    return part if 1 / TIMES < times < TIMES else None
