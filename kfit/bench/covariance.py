"""Whether the covariances of poses are as large as the errors on held-out views."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.bench.held_out_views import HeldOutViews, answer_to
from kfit.core import FitResult
from kfit.geometry import to_opencv, viewing_ray_rotation
from kfit.pose.category_model import CategoryModel
from kfit.pose.covariance import rotation_offset

# Of χ² with 6 degrees of freedom: the bound of the ellipsoid that holds 95 % of a Gaussian's poses.
CHI2_95 = 12.592


def pose_offsets(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> tuple[Tensor, Tensor]:
    """From answers to truths (N, 6), and the answers' covariances (N, 6, 6), as `kfit.pose.PoseResult` has them.

    A squared Mahalanobis distance δᵀ C⁻¹ δ of a truth has a mean of 6, and 95 % of them are below `CHI2_95`, where the
    covariances are right.

    Args:
        model: that made the answers.
        views: with their true poses.
        results: of `kfit.bench.held_out_views.rotation_errors`, none of which failed.
    """
    symmetry = model.card.known.symmetry
    offsets, covariances = [], []
    for number in range(len(views.rotation)):
        answer, place = answer_to(model, views, results, number), views.translation[number]
        pixel = views.intrinsics[number] @ place
        turn = viewing_ray_rotation(pixel[:2] / pixel[2], views.intrinsics[number])
        truth, found = turn @ to_opencv(views.rotation[number]), torch.from_numpy(answer.rotation)
        turned = rotation_offset(truth[None], found[None], symmetry)[0]
        offsets.append(torch.cat([turned, place - torch.from_numpy(answer.translation)]))
        covariances.append(torch.from_numpy(answer.covariance))
    return torch.stack(offsets), torch.stack(covariances)


def squared_mahalanobis(offsets: Tensor, covariances: Tensor) -> Tensor:
    """δᵀ C⁻¹ δ (N,) of offsets (N, M) under covariances (N, M, M)."""
    solved = torch.linalg.solve(covariances, offsets)
    squared: Tensor = (offsets * solved).sum(1)
    return squared
