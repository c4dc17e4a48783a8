"""Starts of a registration: identity, phase correlation, matched features, and random motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import SO3, Initializer, Observation, Variable, Variables
from kfit.generators.volume_motions import volume_matrix_of


class FixedStarts(Initializer):
    """Start each problem at fixed values.

    Args:
        values: (B, S, \\*shape) of each variable.
    """

    def __init__(self, values: Variables) -> None:
        self.values, self.on = values, tuple(values)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        return {name: value.flatten(0, 1) for name, value in self.values.items()}


def candidate_matrices(moving: Tensor, fixed: Tensor, masks: tuple[Tensor, Tensor]) -> Tensor:
    """Return candidate maps of pixels from moving to fixed pictures: the identity, phase correlation, matched features.

    Returns:
        (B, 3, 3, 3); for volumes, which have no such features, (B, 2, 4, 4).
    """
    found = []
    for number in range(len(moving)):
        grey = [picture[number].mean(0).double().cpu() for picture in (moving, fixed)]
        known = [mask[number, 0].cpu() > 0.5 for mask in masks]
        matrices = [torch.eye(grey[0].dim() + 1).double(), phase_correlation(*grey)]
        found.append(torch.stack(matrices if moving.dim() == 5 else [*matrices, matched_features(*grey, *known)]))
    return torch.stack(found).to(moving)


def phase_correlation(moving: Tensor, fixed: Tensor) -> Tensor:
    """Return the shift at the peak of the pictures' phase correlation (Kuglin and Hines, 1975), by scikit-image.

    Args:
        moving, fixed: (H, W) or (D, H, W).

    Returns:
        (3, 3) or (4, 4).
    """
    from skimage.registration import phase_cross_correlation

    axes = [torch.hann_window(side, periodic=False, dtype=torch.float64) for side in moving.shape]
    window = torch.stack(torch.meshgrid(*axes, indexing="ij")).prod(0)
    plain = [((picture - picture.mean()) * window).numpy() for picture in (fixed, moving)]
    matrix = torch.eye(moving.dim() + 1, dtype=torch.float64)
    if min(picture.std() for picture in plain) > 0:
        shift = phase_cross_correlation(*plain)[0]
        matrix[:-1, -1] = torch.as_tensor(shift[::-1].copy())
    return matrix


def matched_features(moving: Tensor, fixed: Tensor, moving_known: Tensor, fixed_known: Tensor) -> Tensor:
    """Return the homography (3, 3) of matched SIFT features, by OpenCV; the identity if too few agree."""
    import cv2
    import numpy as np

    detector, sides = cv2.SIFT_create(2000), []  # type: ignore[attr-defined]
    for grey, known in ((moving, moving_known), (fixed, fixed_known)):
        low, high = (float(end) for end in (grey.min(), grey.max()))
        pixels = ((grey - low) / max(high - low, 1e-6) * 255).round().byte().numpy()
        sides.append(detector.detectAndCompute(pixels, known.byte().numpy()))
    (there, first), (here, second) = sides
    if min(len(there), len(here)) < 4:
        return torch.eye(3, dtype=torch.float64)
    pairs = cv2.BFMatcher().knnMatch(first, second, k=2)
    # Lowe's ratio, 2004, section 7.1.
    good = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < 0.8 * pair[1].distance]
    if len(good) < 8:
        return torch.eye(3, dtype=torch.float64)
    chosen = ((there, [match.queryIdx for match in good]), (here, [match.trainIdx for match in good]))
    ends = [np.array([side[index].pt for index in at], np.float32) for side, at in chosen]
    matrix, agree = cv2.findHomography(ends[0], ends[1], cv2.USAC_MAGSAC, 2.0)
    if matrix is None or agree.sum() < 8 or not np.isfinite(matrix).all() or np.linalg.det(matrix[:2, :2]) <= 0:
        return torch.eye(3, dtype=torch.float64)
    return torch.from_numpy(matrix)


def random_motions(values: Variables, count: int, seed: int) -> Variables:
    """Return random motions (B, count, \\*shape): up to 30°, 0.3 half-widths and 15 % of scale."""
    rng = torch.Generator().manual_seed(seed)
    reach = {"roll": math.radians(30), "shift": 0.3, "scale": 0.15}
    found = {}
    for name, value in values.items():
        offset = (2 * torch.rand(len(value), count, *value.shape[1:], generator=rng) - 1).to(value) * reach.get(name, 0)
        found[name] = offset.exp() if name in ("scale", "stretch") else offset
    return found


def random_volume_matrices(count: int, size: tuple[int, ...], seed: int) -> Tensor:
    """Return random maps of voxels (count, 4, 4): up to 30°, 0.3 half-sides and 15 % of scale."""
    rng = torch.Generator().manual_seed(seed)
    axis = torch.nn.functional.normalize(torch.randn(count, 3, generator=rng), dim=1)
    turn, scale = (reach * (2 * torch.rand(count, 1, generator=rng) - 1) for reach in (30 / 180, 0.15))
    shift = 0.3 * (2 * torch.rand(count, 3, generator=rng) - 1)
    return volume_matrix_of({"rotation": SO3().to_value(turn * axis), "scale": scale[:, 0].exp(), "shift": shift}, size)
