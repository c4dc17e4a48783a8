"""Pairs of views of one object for training and validation, as a LightningDataModule."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning import LightningDataModule
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from kfit.core.check import check_choice, check_count, check_text
from kfit.data.mesh_files import find_meshes
from kfit.data.views import Views, build_views
from kfit.geometry.categories import CATEGORIES


class ViewPairs(Dataset[dict[str, Tensor]]):
    """Every view once as target, with another view of the same object as source.

    Whole batches are fetched by index, and converted to float once. ``source``, ``target`` (B, 3, H, W) in [0, 1];
    ``source_mask``, ``target_mask`` (B, 1, H, W) in [0, 1]; ``target_depth`` (B, 1, H, W) in box diagonals relative to
    the object's centre, 0 outside; ``source_elevation``, ``source_azimuth``, ``elevation``, ``azimuth`` (B,) in
    radians, the latter two of the target; ``extents`` (B, 3). Files without depth or extents give batches without them.

    Args:
        views: Pictures with at least two views an object.
        objects: Which objects to use.
        seed: Chooses the sources.
        epoch: Called for the number of the epoch; each epoch has its own sources.
        device: Where the views are kept and batches made.

    Raises:
        ValueError: If an object has fewer than two views.
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
        self.depth = None if views.depth is None else torch.from_numpy(pick(views.depth))
        self.extents = None if views.extents is None else torch.from_numpy(views.extents[chosen])
        for name in ("images", "masks", "elevations", "azimuths", "depth", "extents"):
            held = getattr(self, name)
            setattr(self, name, None if held is None else held.to(device))
        self._seed, self._epoch = seed, epoch
        self._drawn_for, self._offsets = -1, torch.zeros(0, dtype=torch.long)

    def __len__(self) -> int:
        return len(self.images)

    def sources(self, targets: Tensor) -> Tensor:
        """Rows of the sources (B,) that this epoch pairs with the rows of targets (B,)."""
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
        if self.depth is not None:
            batch["target_depth"] = self.depth[targets].unsqueeze(1).float()
        if self.extents is not None:
            batch["extents"] = self.extents[targets // self.num_views]
        return batch

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return {name: value[0] for name, value in self.__getitems__([index]).items()}


def _as_fetched(batch: Any) -> Any:
    """Batches come whole from ``__getitems__``, so there is nothing to collate."""
    return batch


class ViewsDataModule(LightningDataModule):
    """Pairs of views for training a generator: procedural objects, meshes on disk, or an existing file of views.

    Views are rendered once into ``cache_dir``, by all cores, and reused. They are kept in memory, where a GPU trains in
    the GPU's, if they take less than half of what is free there: no step waits for its batch. Validation shows objects
    of families that training never sees (procedural), or every tenth mesh, or the last objects of an existing file; its
    pairs are the same each time. Batches are those of ``ViewPairs``.

    Args:
        category: Procedural category, one of bottle, bowl, camera, can, laptop and mug.
        num_objects: Objects to train on.
        num_views: Views of each object.
        image_size: Side of the pictures in pixels.
        batch_size: Pairs a batch and process.
        cache_dir: Folder for rendered views.
        meshes: Folder of meshes to use instead of procedural objects.
        views: Existing HDF5 file of views to use instead of rendering any.
        num_val_objects: Objects to validate on, at most a third of an existing file's.
        seed: Chooses objects, poses, pairs and their order.
    """

    def __init__(
        self,
        category: str = "mug",
        num_objects: int = 4000,
        num_views: int = 10,
        image_size: int = 64,
        batch_size: int = 32,
        cache_dir: str = ".kfit_cache",
        meshes: str | None = None,
        views: str | None = None,
        num_val_objects: int = 40,
        seed: int = 0,
    ) -> None:
        super().__init__()
        check_choice("category", category, CATEGORIES)
        check_count("num_objects", num_objects)
        check_count("num_views", num_views, 2)
        check_count("image_size", image_size, 1, 4096)
        check_count("batch_size", batch_size)
        check_count("num_val_objects", num_val_objects)
        check_count("seed", seed, 0)
        for name, path in {"cache_dir": cache_dir, "meshes": meshes, "views": views}.items():
            if path is not None or name == "cache_dir":
                check_text(name, path)
        if meshes is not None and views is not None:
            raise ValueError(f"meshes and views must not both be given, but are {meshes!r} and {views!r}.")
        self.save_hyperparameters()
        self.category, self.num_objects, self.num_views, self.image_size = category, num_objects, num_views, image_size
        self.batch_size, self.cache_dir, self.meshes, self.views = batch_size, cache_dir, meshes, views
        self.num_val_objects, self.seed = num_val_objects, seed
        self.train_pairs: ViewPairs | None = None
        self.val_pairs: ViewPairs | None = None

    def prepare_data(self) -> None:
        """Render what is not in the cache yet, in one process only."""
        if self.views is None:
            self._build(held_out=False)
            self._build(held_out=True)

    def setup(self, stage: str | None = None) -> None:
        """Load the views into memory, as uint8; on a GPU into the GPU's."""
        if self.train_pairs is not None:
            return
        if self.views is not None:
            views = Views(self.views, self.num_views)
            split = views.num_objects - min(self.num_val_objects, max(1, views.num_objects // 3))
            self.train_pairs = ViewPairs(views, range(max(split, 1)), self.seed, self._epoch, self._home(views))
            self.val_pairs = ViewPairs(views, range(min(split, views.num_objects - 1), views.num_objects), self.seed)
            return
        train, val = Views(self._build(held_out=False)), Views(self._build(held_out=True))
        self.train_pairs = ViewPairs(train, range(train.num_objects), self.seed, self._epoch, self._home(train))
        self.val_pairs = ViewPairs(val, range(val.num_objects), self.seed)

    def train_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Shuffled pairs, the same order for the same seed; under DDP Lightning puts its own sampler in."""
        order = torch.Generator().manual_seed(self.seed)
        return self._loader(self.train_pairs, shuffle=True, drop_last=True, generator=order)

    def val_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Fixed pairs in a fixed order."""
        return self._loader(self.val_pairs, shuffle=False, drop_last=False, generator=None)

    def _loader(
        self, pairs: ViewPairs | None, shuffle: bool, drop_last: bool, generator: torch.Generator | None
    ) -> DataLoader[dict[str, Tensor]]:
        if pairs is None:
            raise ValueError("setup must be called before a loader is asked for, but it was not.")
        # Batches are fetched from memory faster than workers could send them, so Lightning's advice does not apply.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        return DataLoader(
            pairs,
            batch_size=self.batch_size,
            shuffle=shuffle,
            drop_last=drop_last and len(pairs) > self.batch_size,
            generator=generator,
            collate_fn=_as_fetched,
        )

    def _epoch(self) -> int:
        return self.trainer.current_epoch if self.trainer is not None else 0

    def _home(self, views: Views) -> torch.device:
        """Where these views are kept while training."""
        device: torch.device = self.trainer.strategy.root_device if self.trainer is not None else torch.device("cpu")
        if device.type != "cuda":
            return torch.device("cpu")
        held = (views.images, views.masks, views.depth)
        needed = sum(array.nbytes for array in held if array is not None)
        return device if 2 * needed < torch.cuda.mem_get_info(device)[0] else torch.device("cpu")

    def _build(self, held_out: bool) -> Path:
        """Path of the train or validation views, rendered if they are not there."""
        source: str | list[Path] = self.category
        name = self.category
        if self.meshes is not None:
            files = find_meshes(self.meshes)
            # Every tenth mesh validates; of fewer than two there is nothing to hold out.
            source = (files[::10] if held_out else [f for i, f in enumerate(files) if i % 10]) or files
            name = Path(self.meshes).resolve().name
        count = self.num_val_objects if held_out else self.num_objects
        part = "val" if held_out else "train"
        file = f"{name}_{part}_{count}x{self.num_views}_{self.image_size}px_seed{self.seed}.h5"
        category = CATEGORIES[self.category]
        return build_views(
            Path(self.cache_dir) / file,
            source,
            count,
            self.num_views,
            self.image_size,
            self.seed,
            held_out,
            category.elevation_deg,
            unit_fraction=category.unit_fraction,
        )
