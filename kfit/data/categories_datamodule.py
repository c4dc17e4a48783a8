"""Pairs of views of several categories at once, as a LightningDataModule."""

from __future__ import annotations

from collections.abc import Sequence

from lightning import LightningDataModule
from lightning.pytorch.utilities import CombinedLoader

from kfit.core.check import check_choice, check_list
from kfit.data.datamodule import ViewsDataModule
from kfit.geometry.categories import CATEGORIES


class CategoriesDataModule(LightningDataModule):
    """Batches by category: each holds a batch of `ViewsDataModule` of every category, without depth.

    Args:
        categories: Procedural categories; all six unless given.
        num_objects: Objects of each to train on.
        num_views: Views of each object.
        image_size: Side of the pictures in pixels.
        batch_size: Pairs of each category a batch and process.
        cache_dir: Folder for rendered views.
        num_val_objects: Objects of each to validate on, and to test on.
        seed: Chooses objects, poses, pairs and their order.

    Example:
        >>> data = CategoriesDataModule(["mug", "can"], num_objects=100)
        >>> list(data.parts)
        ['mug', 'can']
    """

    def __init__(
        self,
        categories: Sequence[str] = tuple(CATEGORIES),
        num_objects: int = 5000,
        num_views: int = 8,
        image_size: int = 80,
        batch_size: int = 2,
        cache_dir: str = ".kfit_cache",
        num_val_objects: int = 40,
        seed: int = 0,
    ) -> None:
        super().__init__()
        check_list("categories", categories, None, check_choice, tuple(CATEGORIES))
        self.save_hyperparameters()
        self.parts = {
            category: ViewsDataModule(
                category,
                num_objects,
                num_views,
                image_size,
                batch_size,
                cache_dir,
                num_val_objects=num_val_objects,
                seed=seed,
            )
            for category in categories
        }

    def prepare_data(self) -> None:
        """Render what is needed and not in the cache yet, in one process only."""
        for part in self.parts.values():
            part.trainer = self.trainer
            part.prepare_data()

    def setup(self, stage: str | None = None) -> None:
        """Load the views that a stage needs into memory, as uint8; on a GPU those of training into the GPU's."""
        for part in self.parts.values():
            part.trainer = self.trainer
            part.setup(stage)
            for pairs in (part.train_pairs, part.val_pairs, part.test_pairs):
                if pairs is not None:
                    pairs.depth = None

    def train_dataloader(self) -> CombinedLoader:
        """Shuffled pairs of all categories, until the largest is through."""
        return CombinedLoader({name: part.train_dataloader() for name, part in self.parts.items()}, "max_size_cycle")

    def val_dataloader(self) -> CombinedLoader:
        """Fixed pairs in a fixed order."""
        return CombinedLoader({name: part.val_dataloader() for name, part in self.parts.items()}, "max_size_cycle")

    def test_dataloader(self) -> CombinedLoader:
        """Fixed pairs in a fixed order."""
        return CombinedLoader({name: part.test_dataloader() for name, part in self.parts.items()}, "max_size_cycle")
