"""The interface of data sets to fit: images with objects, and the storage of results."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from lightning import LightningDataModule
from numpy.typing import NDArray
from torch.utils.data import DataLoader, Dataset, DistributedSampler

from kfit.geometry import Category
from kfit.pose.inputs import as_photo
from kfit.pose.observed_object import ObservedObject
from kfit.pose.result import PoseResult
from kfit.runtime.devices import on_one_core
from kfit.segmentation import Photo


@dataclass
class ObjectToFit:
    """An object in an image.

    Attributes:
        category: as `kfit.geometry.CATEGORIES` spells it, or what else its data calls it.
        mask: (H, W), above one half on the object; None to use the photo's alpha channel.
        key: with the seed it decides the object's random numbers.
        score: score of the detection; None without a detector.
    """

    category: str
    mask: NDArray[Any] | None
    key: int = 0
    score: float | None = None


@dataclass
class ImageToFit:
    """An image and its objects.

    Attributes:
        name: name of its result file.
        image: photo, or (H, W, 3) RGB, as `kfit.pose.CategoryModel.pose` takes it.
        objects: in any number.
        intrinsics: (3, 3), where the data knows them.
        depth: (H, W) in metres, where it was measured.
        source: anything that the data set needs again when the result is written.
        observed: the objects cut out, or sentences why one cannot be; see `ObjectCropper`.
    """

    name: str
    image: Photo | NDArray[Any]
    objects: list[ObjectToFit]
    intrinsics: NDArray[Any] | None = None
    depth: NDArray[Any] | None = None
    source: Any = None
    observed: list[ObservedObject | str] = field(default_factory=list)


@dataclass
class Unreadable:
    """Placeholder of an image that cannot be used, with the reason."""

    name: str
    why: str


@dataclass(frozen=True)
class ObjectCropper:
    """Cuts objects out of an image in the form that the models of their categories need.

    Attributes:
        models: category and side length in pixels of the pictures of each model, by the category's name.
        depth: whether the image's depth is to be used.
    """

    models: Mapping[str, tuple[Category, int]]
    depth: bool

    def __call__(self, image: ImageToFit) -> list[ObservedObject | str]:
        """Each of the image's objects cut out, or a sentence."""
        photo = image.image if isinstance(image.image, Photo) else as_photo(image.image)  # the same array for all
        return [self._one(image, photo, thing) for thing in image.objects]

    def _one(self, image: ImageToFit, photo: Photo | NDArray[Any], thing: ObjectToFit) -> ObservedObject | str:
        if thing.category not in self.models:
            return "there is no model" + " that draws depth" * self.depth + " of the category"
        if self.depth and image.depth is None:
            return "there is no depth of the image"
        category, size = self.models[thing.category]
        depth = image.depth if self.depth else None
        try:
            return ObservedObject.of(photo, category, size, thing.mask, intrinsics=image.intrinsics, depth=depth)
        except ValueError as error:
            return str(error)


class FitData(LightningDataModule, ABC):
    """A data set that `kfit.batch.dataset_fit.DatasetFit` fits; each image has one file for its result.

    Attributes:
        categories: categories of the objects that can occur.
        batch_size: images that are fitted at once in a process.
        left: names of the results that are to be made, the same in all processes; see `plan`.
        cropper: cuts the objects out; see `plan`.
        num_workers: processes that read images and cut objects out; see `plan`.
    """

    categories: Collection[str]
    batch_size: int = 1
    left: Sequence[str] = ()
    cropper: ObjectCropper | None = None
    num_workers: int = 0

    def __init__(self) -> None:
        super().__init__()
        # Fits of different processes never wait for one another, so one may well have none.
        self.allow_zero_length_dataloader_with_multiple_devices = True

    def plan(self, left: Sequence[str], cropper: ObjectCropper, num_workers: int) -> None:
        """Take what `kfit.batch.dataset_fit.DatasetFit` has decided before it fits."""
        self.left, self.cropper, self.num_workers = left, cropper, num_workers

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """What decides the results, in plain values."""

    @abstractmethod
    def names(self) -> list[str]:
        """Names of all results' files.

        Raises:
            FileNotFoundError, ValueError: if there are no images, in one sentence.
        """

    @abstractmethod
    def read(self, name: str) -> ImageToFit:
        """The image whose result has this name.

        Raises:
            OSError, ValueError: if it cannot be used, in one sentence.
        """

    @abstractmethod
    def write(self, path: Path, image: ImageToFit, answers: Sequence[PoseResult | str]) -> None:
        """Write an image's result, if there is one: for each object an answer, or the reason why it has none."""

    def predict_dataloader(self) -> DataLoader[ImageToFit | Unreadable]:
        """What is left, every process's own part of it."""
        # On a CPU images are read far faster than fitted, so Lightning's advice does not apply.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*use of fork\\(\\) may lead to deadlocks.*")
        warnings.filterwarnings("ignore", message=".*across ranks is zero.*")
        rank, count = (self.trainer.global_rank, self.trainer.world_size) if self.trainer is not None else (0, 1)
        images = _Images(self, self.left)
        return DataLoader(
            images,
            batch_size=self.batch_size,
            sampler=_Part(images, count, rank),
            collate_fn=list,
            num_workers=self.num_workers,
            prefetch_factor=1 if self.num_workers else None,  # batches of photos are large
            worker_init_fn=on_one_core,
        )

    def transfer_batch_to_device(self, batch: Any, device: torch.device, dataloader_idx: int) -> Any:
        """Images stay where they are; what is cut out of them goes to the device."""
        return batch


class _Images(Dataset[ImageToFit | Unreadable]):
    def __init__(self, data: FitData, names: Sequence[str]) -> None:
        self.data, self.names = data, names

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> ImageToFit | Unreadable:
        try:
            image = self.data.read(self.names[index])
            return image if self.data.cropper is None else replace(image, observed=self.data.cropper(image))
        except (OSError, ValueError) as error:
            return Unreadable(self.names[index], str(error))


class _Part(DistributedSampler[Any]):
    """Each image in one process only: torch's own repeats some, Lightning's fails where a process would have none."""

    def __init__(self, images: _Images, count: int, rank: int) -> None:
        super().__init__(images, count, rank, shuffle=False)
        self.indices = range(rank, len(images), count)

    def __iter__(self) -> Iterator[int]:
        return iter(self.indices)

    def __len__(self) -> int:
        return len(self.indices)
