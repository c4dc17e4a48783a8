"""The object's mask near where it was drawn last."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from kfit.segmentation.largest_part import largest_part

ITERATIONS = 2
# A mask of another area than this many times the silhouette's, either way, is of something else.
TIMES = 2.0


def mask_near(image: NDArray[np.float32], silhouette: NDArray[np.float32], band: int) -> NDArray[np.uint8] | None:
    """GrabCut where a silhouette leaves it open: within a band about its outline.

    What is farther inside is object, farther outside is background, and the colours of both decide in between (Rother,
    Kolmogorov, Blake 2004). Of what is found the largest connected part is kept.

    Args:
        image: (H, W, 3), RGB in [0, 1].
        silhouette: (H, W), above 1/2 on the object as it was drawn.
        band: pixels to either side of the outline.

    Returns:
        (H, W) of 0 and 1; None where nothing like the silhouette stands out.
    """
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
