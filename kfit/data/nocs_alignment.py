"""The pose of an object from its NOCS coordinates and depth, as a similarity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.measure import ransac
from skimage.transform import SimilarityTransform

from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.runtime.ignored_warnings import ignore_warnings

_MIN_PAIRS = 16


def align(
    coordinates: NDArray[np.floating],
    points: NDArray[np.floating],
    tolerance: float = 0.01,
    num_trials: int = 200,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Estimate the similarity x ↦ s R x + t from object coordinates to camera points, robust to outliers.

    RANSAC over samples of five pairs, each fitted by Umeyama's least squares, then a fit of all pairs that agree with
    the best (scikit-image's ransac). NOCS's aligning.py does the same with a tolerance so wide that nearly all pairs
    agree.

    Args:
        coordinates: (M, 3) in the object's frame.
        points: (M, 3) of the camera, in metres.
        tolerance: distance in metres up to which a pair agrees.
        num_trials: samples at most.
        seed: chooses the samples.

    Returns:
        (4, 4) of [s R | t].

    Raises:
        ValueError: if there are fewer than 16 pairs, or no similarity explains a tenth of them.

    Example:
        >>> import numpy as np
        >>> from kfit.data import align
        >>> coordinates = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 3))
        >>> similarity = align(coordinates, 0.2 * coordinates + [0.0, 0.0, 1.0])
        >>> similarity[0, 0].round(3), similarity[2, 3].round(3)
        (np.float64(0.2), np.float64(1.0))
    """
    check_arguments(align, locals(), tolerance=(check_positive,), seed=(0,))
    if coordinates.shape != points.shape or coordinates.ndim != 2 or coordinates.shape[1] != 3:
        raise ValueError(f"coordinates and points must both be (M, 3), got {coordinates.shape} and {points.shape}")
    if len(points) < _MIN_PAIRS:
        raise ValueError(f"coordinates and points must hold at least {_MIN_PAIRS} pairs, got {len(points)}")
    with ignore_warnings():  # no agreement is reported below, in one sentence
        model, agree = ransac(
            (coordinates.astype(np.float64), points.astype(np.float64)),
            SimilarityTransform,
            min_samples=5,
            residual_threshold=tolerance,
            max_trials=num_trials,
            stop_probability=0.9999,
            rng=seed,
        )
    if model is None or not agree.mean() >= 0.1:
        raise ValueError(f"no similarity brings a tenth of {len(points)} pairs within {tolerance:g} m of each other")
    pose: NDArray[np.float64] = model.params
    return pose
