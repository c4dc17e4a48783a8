"""Pairs of views of the same object."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from kfit.data.views import Views


class ViewPairs(Dataset[dict[str, Tensor]]):
    """All views as targets, each with another view of the same object as source.

    Whole batches are fetched by index, and converted to float once. ``source``, ``target`` (B, 3, H, W) in [0, 1];
    ``source_mask``, ``target_mask`` (B, 1, H, W) in [0, 1]; ``target_depth`` (B, 1, H, W) in box diagonals relative to
    the object's centre, 0 outside; ``source_elevation``, ``source_azimuth``, ``elevation``, ``azimuth`` (B,) in
    radians, the latter two of the target; ``source_distance``, ``distance`` (B,) of the cameras in box diagonals;
    ``extents`` (B, 3). Files without distances, depth or extents give batches without them.

    Args:
        views: Pictures with at least two views an object.
        objects: Which objects to use.
        seed: Chooses the sources.
        epoch: Called for the number of the epoch; each epoch has its own sources.
        device: Where the views are kept and batches made.

    Raises:
        ValueError: If an object has fewer than two views.

    Example:
        >>> from kfit.data import Views, ViewPairs, build_views
        >>> path = build_views("views.h5", "can", num_objects=1, num_views=2, image_size=16)
        >>> pairs = ViewPairs(Views("views.h5"), objects=[0], seed=0)
        >>> pairs.__getitems__([0, 1])["target"].shape
        torch.Size([2, 3, 16, 16])
    """

    def __init__(
        self,
        views: Views,
        objects: Sequence[int],
        seed: int,
        epoch: Callable[[], int] = lambda: 0,
        device: str | torch.device = "cpu",
    ) -> None:
        if views.num_views < 2:
            raise ValueError(f"num_views must be at least 2 to make pairs, but is {views.num_views}.")
        chosen = np.asarray(objects, np.int64)
        rows = (chosen[:, None] * views.num_views + np.arange(views.num_views)).ravel()
        whole = len(rows) == len(views.images)
        pick: Callable[[np.ndarray], np.ndarray] = (lambda array: array) if whole else (lambda array: array[rows])
        self.num_views = views.num_views
        self.images = torch.from_numpy(np.ascontiguousarray(pick(views.images).transpose(0, 3, 1, 2)))
        self.masks = torch.from_numpy(np.ascontiguousarray(pick(views.masks)))
        self.elevations = torch.from_numpy(pick(views.elevations).copy())
        self.azimuths = torch.from_numpy(pick(views.azimuths).copy())
        self.distances = None if views.distances is None else torch.from_numpy(pick(views.distances)).float()
        self.depth = None if views.depth is None else torch.from_numpy(pick(views.depth))
        self.extents = None if views.extents is None else torch.from_numpy(views.extents[chosen])
        for name in ("images", "masks", "elevations", "azimuths", "distances", "depth", "extents"):
            held = getattr(self, name)
            setattr(self, name, None if held is None else held.to(device))
        self._seed, self._epoch = seed, epoch
        self._drawn_for, self._offsets = -1, torch.zeros(0, dtype=torch.long)

    def __len__(self) -> int:
        return len(self.images)

    def sources(self, targets: Tensor) -> Tensor:
        """Return rows of the sources (B,) that this epoch pairs with the rows of targets (B,)."""
        epoch = self._epoch()
        if epoch != self._drawn_for:
            rng = np.random.default_rng([self._seed, epoch])
            self._offsets = torch.from_numpy(rng.integers(1, self.num_views, len(self)))
            self._drawn_for = epoch
        first = targets - targets % self.num_views
        return first + (targets + self._offsets[targets]) % self.num_views

    def __getitems__(self, indices: Sequence[int]) -> dict[str, Tensor]:
        targets = torch.as_tensor(indices, dtype=torch.long)
        sources = self.sources(targets)
        targets, sources = (rows.to(self.images.device, non_blocking=True) for rows in (targets, sources))
        batch = {
            "source": self.images[sources].float().div_(255),
            "source_mask": self.masks[sources].unsqueeze(1).float().div_(255),
            "source_elevation": self.elevations[sources],
            "source_azimuth": self.azimuths[sources],
            "target": self.images[targets].float().div_(255),
            "target_mask": self.masks[targets].unsqueeze(1).float().div_(255),
            "elevation": self.elevations[targets],
            "azimuth": self.azimuths[targets],
        }
        if self.distances is not None:
            batch["source_distance"], batch["distance"] = self.distances[sources], self.distances[targets]
        if self.depth is not None:
            batch["target_depth"] = self.depth[targets].unsqueeze(1).float()
        if self.extents is not None:
            batch["extents"] = self.extents[targets // self.num_views]
        return batch

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return {name: value[0] for name, value in self.__getitems__([index]).items()}
