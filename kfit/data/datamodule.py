"""Pairs of views of one object for training, validation and test, as a LightningDataModule."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from lightning import LightningDataModule
from torch import Tensor
from torch.utils.data import DataLoader, DistributedSampler

from kfit.core.arguments import check_arguments
from kfit.core.check import check_rising
from kfit.data.category_files import read_category
from kfit.data.mesh_places import MeshFile, find_mesh_files
from kfit.data.rendered_views import build_views, settings_of
from kfit.data.view_pairs import ViewPairs
from kfit.data.views import Views
from kfit.geometry.categories import CATEGORIES, Category

LEARN = ("train", "val")
# What else than training needs.
PARTS: dict[str | None, tuple[str, ...]] = {"validate": ("val",), "test": ("test",)}
# Far from the seeds that people give, so that no other run has trained or been chosen by these objects.
TEST_SEED = 1_000_000
# Distances of views, in box diagonals, unless a recipe asks for others.
DISTANCES = (1.3, 8.0)


def _as_fetched(batch: Any) -> Any:
    """Return the batch unchanged, because ``__getitems__`` collates it."""
    return batch


class ViewsDataModule(LightningDataModule):
    """Pairs of views for training a generator: of procedural objects, meshes on disk, or an existing file of views.

    Views are rendered once into ``cache_dir``, by all cores, and reused. They are kept in memory (of the GPU, if it
    trains and they take less than half of its free memory), so that no step waits for its batch. Validation uses
    objects of families that are not in the training data (procedural), or every tenth mesh, or the last objects of an
    existing file; its pairs are fixed. Test uses as many others of those families, the same meshes from other
    directions and in other light, or other pairs of the same objects of the file. Batches are those of ``ViewPairs``.

    Args:
        category: One of bottle, bowl, camera, can, laptop and mug; or a custom one, as a YAML file with the fields
            of `kfit.geometry.Category` or the import path of one.
        num_objects: Objects to train on.
        num_views: Views of each object.
        image_size: Side of the pictures in pixels.
        batch_size: Pairs a batch and process.
        cache_dir: Folder for rendered views.
        meshes: Places and orientations of meshes to use instead of procedural objects, as
            ``kfit.data.mesh_places`` reads it: a folder with y up, ``FOLDER@z``, or a list of such.
        views: Existing HDF5 file of views to use instead of rendering any.
        num_val_objects: Objects to validate on, and to test on; at most a third of an existing file's.
        distance_range: Range of the camera's distance in box diagonals; equal ends fix it.
        seed: Chooses objects, poses, pairs and their order.

    Example:
        >>> from kfit.data import ViewsDataModule
        >>> data = ViewsDataModule(category="mug", num_objects=2, num_views=2, num_val_objects=1)
        >>> data.setup("fit")  # renders the views  # doctest: +SKIP
        >>> batch = next(iter(data.train_dataloader()))  # doctest: +SKIP
    """

    def __init__(
        self,
        category: str | Category = "mug",
        num_objects: int = 4000,
        num_views: int = 10,
        image_size: int = 64,
        batch_size: int = 32,
        cache_dir: str = ".kfit_cache",
        meshes: str | list[str] | None = None,
        views: str | None = None,
        num_val_objects: int = 40,
        distance_range: tuple[float, float] = DISTANCES,
        seed: int = 0,
    ) -> None:
        super().__init__()
        check_arguments(ViewsDataModule, locals(), num_views=(2,), distance_range=(check_rising, 1, 1e6), seed=(0,))
        if meshes is not None and views is not None:
            raise ValueError(f"meshes and views must not both be given, but are {meshes!r} and {views!r}.")
        self.category = read_category(category)
        if self.category.shapes is None and meshes is None and views is None:
            raise ValueError(f"category {self.category.name} has no shapes to draw, so meshes or views must be given")
        self.save_hyperparameters()
        # As plain data, so that a checkpoint holds all of it on another machine too.
        own = self.category != CATEGORIES.get(self.category.name)
        self.hparams["category"] = self.category.to_dict() if own else self.category.name
        self.num_objects, self.num_views, self.image_size = num_objects, num_views, image_size
        self.batch_size, self.cache_dir, self.meshes, self.views = batch_size, cache_dir, meshes, views
        self.num_val_objects, self.distance_range, self.seed = num_val_objects, distance_range, seed
        self.train_pairs: ViewPairs | None = None
        self.val_pairs: ViewPairs | None = None
        self.test_pairs: ViewPairs | None = None

    def prepare_data(self) -> None:
        """Render views that are not in the cache yet, in one process only."""
        if self.views is None:
            for part in PARTS.get(self.trainer.state.fn, LEARN) if self.trainer is not None else LEARN:
                self._build(part)

    def setup(self, stage: str | None = None) -> None:
        """Load the views of a stage into memory, as uint8; those of training into the GPU's memory if possible.

        Without a stage the views of training and validation are loaded.
        """
        needed = [part for part in PARTS.get(stage, LEARN) if getattr(self, f"{part}_pairs") is None]
        file = Views(self.views, self.num_views) if needed and self.views is not None else None
        for part in needed:
            setattr(self, f"{part}_pairs", self._pairs(part, file))

    def fingerprint(self) -> str:
        """16 hexadecimal digits that identify the training data: its sources and rendering, or a file's content."""
        if self.views is not None:
            with open(self.views, "rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()[:16]
        return hashlib.sha256(json.dumps(settings_of(self._build("train"))).encode()).hexdigest()[:16]

    def train_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Return shuffled pairs, each process's part of them.

        Their order depends on the seed and the epoch alone, so that a training resumed from a checkpoint uses the same
        pairs.
        """
        pairs = _there(self.train_pairs)
        rank, count = (self.trainer.global_rank, self.trainer.world_size) if self.trainer is not None else (0, 1)
        order: DistributedSampler[Any] = DistributedSampler(pairs, count, rank, shuffle=True, seed=self.seed)
        return self._loader(pairs, order, drop_last=len(pairs) > self.batch_size)

    def val_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Return fixed pairs in a fixed order."""
        return self._loader(_there(self.val_pairs))

    def test_dataloader(self) -> DataLoader[dict[str, Tensor]]:
        """Return fixed pairs in a fixed order."""
        return self._loader(_there(self.test_pairs))

    def _loader(
        self, pairs: ViewPairs, order: DistributedSampler[Any] | None = None, drop_last: bool = False
    ) -> DataLoader[dict[str, Tensor]]:
        # Batches are fetched from memory faster than workers could send them, so Lightning's advice does not apply.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        return DataLoader(pairs, self.batch_size, sampler=order, drop_last=drop_last, collate_fn=_as_fetched)

    def _epoch(self) -> int:
        return self.trainer.current_epoch if self.trainer is not None else 0

    def _home(self, views: Views) -> torch.device:
        """Device that holds these views during training."""
        device: torch.device = self.trainer.strategy.root_device if self.trainer is not None else torch.device("cpu")
        if device.type != "cuda":
            return torch.device("cpu")
        held = (views.images, views.masks, views.depth)
        needed = sum(array.nbytes for array in held if array is not None)
        return device if 2 * needed < torch.cuda.mem_get_info(device)[0] else torch.device("cpu")

    def _pairs(self, part: str, file: Views | None) -> ViewPairs:
        """Pairs of views for train, val or test: of the file that was given, or rendered if they are not there."""
        views = Views(self._build(part)) if file is None else file
        objects = range(views.num_objects)
        if file is not None:
            split = views.num_objects - min(self.num_val_objects, max(1, views.num_objects // 3))
            objects = objects[: max(split, 1)] if part == "train" else objects[min(split, views.num_objects - 1) :]
        if part == "train":
            return ViewPairs(views, objects, self.seed, self._epoch, self._home(views))
        return ViewPairs(views, objects, self._seed_of(part))

    def _seed_of(self, part: str) -> int:
        return self.seed + TEST_SEED if part == "test" else self.seed

    @cached_property
    def _mesh_files(self) -> list[MeshFile]:
        """Mesh files, looked for once, so that the log lists only once what is not read."""
        return [] if self.meshes is None else find_mesh_files(self.meshes, [self.category.name])

    def _build(self, part: str) -> Path:
        """Path of the views for train, val or test, rendered if they are not there."""
        source: Category | list[MeshFile] = self.category
        name = self.category.name
        held_out = part != "train"
        if self.meshes is not None:
            files = self._mesh_files
            # Every tenth mesh validates; of fewer than two there is nothing to hold out.
            source = (files[::10] if held_out else [f for i, f in enumerate(files) if i % 10]) or files
            name = _common_name(files)
        count = self.num_val_objects if held_out else self.num_objects
        # Trainings of one category with other distances keep files of their own.
        low, high = self.distance_range
        far = "" if (low, high) == DISTANCES else f"_distance{low:g}to{high:g}"
        file = f"{name}_{part}_{count}x{self.num_views}_{self.image_size}px{far}_seed{self.seed}.h5"
        return build_views(
            Path(self.cache_dir) / file,
            source,
            count,
            self.num_views,
            self.image_size,
            self._seed_of(part),
            held_out,
            self.category.elevation_deg,
            self.category.upright,
            distance=self.distance_range,
            unit_fraction=self.category.unit_fraction,
        )


def _common_name(files: list[MeshFile]) -> str:
    """Name of the folder that holds all files."""
    return Path(os.path.commonpath([file.path.absolute().parent for file in files])).name or "meshes"


def _there(pairs: ViewPairs | None) -> ViewPairs:
    if pairs is None:
        raise ValueError("setup must be called before a loader is asked for, but it was not.")
    return pairs
