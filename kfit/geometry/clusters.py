"""Many estimates of one object's rotation: which of them agree, what each weighs, how far they spread."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kfit.core.check import check_positive, check_range
from kfit.geometry.pose import Symmetry, rotation_error

# Rotations closer than this are one pose, and an estimate weighs exp(−(E − E_best) / (0.1 · E_best)).
WITHIN_DEG = 20.0
TEMPERATURE = 0.1


def rotation_clusters(
    rotation: Tensor, energy: Tensor, symmetry: Symmetry = "none", within_deg: float = WITHIN_DEG
) -> Tensor:
    """Number of the cluster (N,) that each of N rotations belongs to.

    Cluster 0 holds the rotation of lowest energy and all within ``within_deg`` of it, cluster 1 the best of the others
    and those of the others within ``within_deg`` of it, and so on; so a cluster's best member is at its centre.

    Args:
        rotation: (N, 3, 3) in the same frame.
        energy: (N,), lower is better.
        symmetry: of the object: with ``"y"`` turns about its vertical axis are the same pose.
        within_deg: largest distance from the best member.
    """
    check_range("within_deg", within_deg, 0, 180)
    near = rotation_error(rotation[:, None], rotation[None], symmetry) <= math.radians(within_deg)
    near |= torch.eye(len(rotation), dtype=torch.bool, device=rotation.device)
    cluster = torch.full_like(energy, -1, dtype=torch.long)
    for best in energy.argsort(stable=True).tolist():
        if cluster[best] < 0:
            cluster[near[best] & (cluster < 0)] = cluster.max() + 1
    return cluster


def energy_weights(energy: Tensor, temperature: float = TEMPERATURE) -> Tensor:
    """Share (N,) of each of N estimates by its energy: exp(−(E − E_min) / (temperature · |E_min|)), summing to 1.

    The temperature is relative, since energies differ from picture to picture by what no pose explains.
    """
    check_positive("temperature", temperature)
    best = energy.min()
    return torch.softmax(-(energy - best) / (temperature * best.abs() + 1e-9), 0)


def rotation_sigma_deg(rotation: Tensor, weight: Tensor, centre: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Weighted angular standard deviation √(Σ w d² / Σ w) in degrees, d the angles of N rotations from a centre.

    Args:
        rotation: (N, 3, 3).
        weight: (N,), not all 0.
        centre: (3, 3).
        symmetry: of the object; with ``"y"`` d is the angle between vertical axes.
    """
    away = rotation_error(centre, rotation, symmetry).rad2deg()
    return ((weight * away.square()).sum() / weight.sum()).sqrt()
