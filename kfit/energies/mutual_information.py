"""Mutual information."""

from __future__ import annotations

from typing import Any

import torch
from kornia.losses.mutual_information import xu_kernel
from torch import Tensor

from kfit.core import Energy
from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.energies.weighting import fill_background, normalized_weights


class MutualInformation(Energy):
    """Normalised mutual information as an energy: it compares pictures whose colours mean different things.

    E = 2 − (H(x) + H(y)) / H(x, y), the mean over channels, with entropies of a joint histogram over [0, 1] in which a
    smooth kernel divides each pixel between the neighbouring bins. E is 1 for independent pictures and lowest where one
    picture determines the other. The kernel blurs the histogram, so E of a picture and itself is above 0 unless its
    colours lie at the centres of bins. Values outside [0, 1] are clipped.

    Shape: pictures (N, C, H, W) in [0, 1], weight (N, 1, H, W), energy (N,) in [0, 1]; volumes
    (N, C, D, H, W) too.
    Source: Studholme, Hill and Hawkes, An overlap invariant entropy measure of 3D medical image alignment, 1999, whose
    measure is 2 − E; soft histograms as Mattes et al., 2003, with Kornia's kernel of Xu et al., 2008, eq. 22. For
    pictures that fill [0, 1] it equals Kornia's ``normalized_mutual_information_loss`` plus 2; Kornia's loss takes no
    weights, and stretches each picture to its own range.

    Args:
        num_bins: bins of the histogram along each side; their centres lie at 0, 1 / (num_bins − 1), …, 1.

    Raises:
        ValueError: if there are fewer than 2 bins, or the pictures' shapes differ.

    Example:
        >>> import torch
        >>> from kfit.energies import MutualInformation
        >>> picture = torch.rand(1, 1, 32, 32)
        >>> energy = MutualInformation(num_bins=8)
        >>> energy(1 - picture, picture) < energy(torch.rand(1, 1, 32, 32), picture)  # a negative, a stranger
        tensor([True])
    """

    volumes = True
    unit_range = True

    def __init__(self, num_bins: int = 32) -> None:
        super().__init__()
        check_arguments(MutualInformation, locals(), num_bins=(2,))
        self.num_bins = num_bins

    def prepare(self, target: Any, weight: Tensor | None = None) -> Any:
        target = fill_background(target, weight)
        low, near = self._bins(target)
        # each channel has a histogram of its own, so its shares must sum to 1
        share = normalized_weights(weight, target[:, :1]).flatten(2).unsqueeze(2)
        found = {"target": target, "low": low, "near": near * share}
        return found if weight is None else found | {"weight": weight}

    def compare(self, prediction: Any, prepared: Any) -> Tensor:
        check_shape("prediction", prediction, tuple(prepared["target"].shape))
        low, near = self._bins(fill_background(prediction, prepared.get("weight")))
        count = self.num_bins
        # a pixel falls into four bins: the two of the prediction by the two of the target
        apart = torch.tensor([0, 1, count, count + 1], device=low.device)[:, None]
        index = (low * count + prepared["low"]).unsqueeze(2) + apart
        falls = near.unsqueeze(3) * prepared["near"].unsqueeze(2)
        joint = falls.new_zeros(*falls.shape[:2], count**2).scatter_add(2, index.flatten(2), falls.flatten(2))
        both, table = _entropy(joint), joint.unflatten(2, (count, count))
        # two pictures of one colour each have no entropy at all, and agree
        excess = 2 * both - _entropy(table.sum(2)) - _entropy(table.sum(3))
        return (excess / torch.where(both > 1e-6, both, 1)).mean(1)

    def _bins(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Lower of the two bins (N, C, H·W) between whose centres each pixel lies, and its parts (N, C, 2, H·W)."""
        place = image.to(torch.promote_types(image.dtype, torch.float32)).clamp(0, 1).flatten(2) * (self.num_bins - 1)
        # NaN has no bin: it must not disturb other rows, and must make its own row NaN
        low = place.detach().nan_to_num().long().clamp_max(self.num_bins - 2)
        part = place - low
        near: Tensor = xu_kernel(torch.stack([part, part - 1], 2))
        return low, torch.where(part.isnan().unsqueeze(2), torch.nan, near)


def _entropy(share: Tensor) -> Tensor:
    """−Σ p log p over the last axis; of empty bins 0, slope included."""
    return -(share * share.clamp_min(1e-12).log()).sum(-1)
