"""Whether the covariances of poses are as large as the errors on held-out views."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from kfit.bench.held_out_views import HeldOutViews, answer_to
from kfit.core import FitResult
from kfit.geometry import to_opencv, viewing_ray_rotation
from kfit.pose.category_model import CategoryModel
from kfit.pose.covariance import rotation_offset


def pose_offsets(
    model: CategoryModel, views: HeldOutViews, results: list[FitResult], numbers: Sequence[int] | None = None
) -> tuple[Tensor, Tensor]:
    """From answers to truths (N, 6), and the answers' covariances (N, 6, 6), as `kfit.pose.PoseResult` has them.

    Of squared Mahalanobis distances δᵀ C⁻¹ δ 95 % are below `kfit.pose.calibrating.CHI2_95` where the covariances are
    right.

    Args:
        model: model that gave the answers.
        views: with their true poses.
        results: results of `kfit.bench.held_out_views.rotation_errors`.
        numbers: numbers of the views that are compared, none of which failed; all by default.
    """
    symmetry = model.card.known.symmetry
    offsets, covariances = [], []
    for number in range(len(views.rotation)) if numbers is None else numbers:
        answer, place = answer_to(model, views, results, number), views.translation[number]
        pixel = views.intrinsics[number] @ place
        turn = viewing_ray_rotation(pixel[:2] / pixel[2], views.intrinsics[number])
        truth, found = turn @ to_opencv(views.rotation[number]), torch.from_numpy(answer.rotation)
        offset = rotation_offset(truth[None], found[None], symmetry)[0]
        offsets.append(torch.cat([offset, place - torch.from_numpy(answer.translation)]))
        covariances.append(torch.from_numpy(answer.covariance))
    if not offsets:
        return torch.zeros(0, 6).double(), torch.zeros(0, 6, 6).double()
    return torch.stack(offsets), torch.stack(covariances)


def squared_mahalanobis(offsets: Tensor, covariances: Tensor) -> Tensor:
    """δᵀ C⁻¹ δ (N,) of offsets (N, M) under covariances (N, M, M)."""
    solved = torch.linalg.solve(covariances, offsets)
    squared: Tensor = (offsets * solved).sum(1)
    return squared
