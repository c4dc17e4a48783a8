"""Agreement, weights and spread of many estimates of one rotation."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core.arguments import check_arguments
from kfit.core.check import check_positive
from kfit.geometry.pose import rotation_error
from kfit.geometry.symmetry import Symmetry

# Rotations closer than this count as one pose, and an estimate weighs exp(−(E − E_best) / (0.1 · E_best)).
WITHIN_DEG = 20.0
TEMPERATURE = 0.1


def rotation_clusters(
    rotation: Tensor, energy: Tensor, symmetry: Symmetry = "none", within_deg: float = WITHIN_DEG
) -> Tensor:
    """Return the number (N,) of the cluster of each of N rotations.

    Cluster 0 holds the rotation of lowest energy and all within ``within_deg`` of it, cluster 1 the best of the
    remaining rotations and those of them within ``within_deg`` of it, and so on; a cluster's best member is at its
    centre.

    Args:
        rotation: (N, 3, 3) in the same frame.
        energy: (N,), lower is better.
        symmetry: symmetry of the object; ``"y"`` ignores rotations about its vertical axis.
        within_deg: largest angle from the best member, in [0°, 180°].

    Example:
        >>> import torch
        >>> from kfit.geometry import rotation_clusters, rotation_from_angles
        >>> azimuth, zero = torch.tensor([0.0, 0.1, 3.0]), torch.zeros(3)
        >>> rotation_clusters(rotation_from_angles(azimuth, zero, zero), torch.tensor([0.2, 0.3, 0.1]))
        tensor([1, 1, 0])
    """
    check_arguments(rotation_clusters, locals(), within_deg=(0, 180))
    near = rotation_error(rotation[:, None], rotation[None], symmetry) <= math.radians(within_deg)
    near |= torch.eye(len(rotation), dtype=torch.bool, device=rotation.device)
    cluster = torch.full_like(energy, -1, dtype=torch.long)
    for best in energy.argsort(stable=True).tolist():
        if cluster[best] < 0:
            cluster[near[best] & (cluster < 0)] = cluster.max() + 1
    return cluster


def energy_weights(energy: Tensor, temperature: float = TEMPERATURE) -> Tensor:
    """Return normalised weights (N,) of N estimates by energy: exp(−(E − E_min) / (temperature · |E_min|)), with sum 1.

    The temperature is relative, because the part of the energy that no pose explains differs from picture to picture.

    Example:
        >>> import torch
        >>> from kfit.geometry import energy_weights
        >>> energy_weights(torch.tensor([0.20, 0.22, 0.40]))
        tensor([7.3103e-01, 2.6893e-01, 3.3189e-05])
    """
    check_arguments(energy_weights, locals(), temperature=(check_positive,))
    best = energy.min()
    return torch.softmax(-(energy - best) / (float(temperature) * best.abs() + 1e-9), 0)


def rotation_sigma_deg(rotation: Tensor, weight: Tensor, centre: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Return the weighted angular standard deviation √(Σ w d² / Σ w) of N rotations, in degrees.

    Args:
        rotation: (N, 3, 3).
        weight: (N,), not all 0.
        centre: (3, 3), from which the angles d are measured.
        symmetry: symmetry of the object; with ``"y"`` d is the angle between vertical axes.

    Example:
        >>> import torch
        >>> from kfit.geometry import rotation_from_angles, rotation_sigma_deg
        >>> azimuth, zero = torch.tensor([-0.1, 0.1]), torch.zeros(2)
        >>> rotation_sigma_deg(rotation_from_angles(azimuth, zero, zero), torch.ones(2), torch.eye(3))
        tensor(5.7296)
    """
    away = rotation_error(centre, rotation, symmetry).rad2deg()
    return ((weight * away.square()).sum() / weight.sum()).sqrt()
