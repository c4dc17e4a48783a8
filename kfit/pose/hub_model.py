"""Models that are shared through the Hugging Face Hub or a folder."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

from torch import nn

from kfit.pose.card import Card
from kfit.pose.hub import find_model, save_folder, upload
from kfit.pose.model_files import model_content, read_model


class HubModel:
    """Methods of `kfit.pose.CategoryModel` that share models.

    Attributes:
        card: card of the model.
    """

    card: Card

    @property
    def networks(self) -> dict[str, nn.Module]:
        """The model's networks by their names in the card."""
        raise NotImplementedError

    @classmethod
    def from_pretrained(cls, name: str | Path, *, revision: str | None = None, offline: bool = False) -> Self:
        """Load a model that `push_to_hub` shared: from the Hugging Face Hub, its cache on this machine, or a folder.

        The file is checked by its SHA-256 and read as data: nothing in it runs.

        >>> import kfit
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     place = kfit.load("mug").push_to_hub(Path(folder))
        ...     kfit.pose.CategoryModel.from_pretrained(place).card.category
        'mug'

        Args:
            name: ``user/name`` of a repository, or a folder.
            revision: branch, tag or commit of the repository.
            offline: take what the cache holds, and ask nobody.

        Raises:
            FileNotFoundError: if there is no such model.
            ImportError: For a repository, if huggingface_hub is not installed (``pip install 'kfit[hub]'``).
            ValueError: for a file that was damaged or replaced, or is no model.
        """
        networks, card = read_model(find_model(name, revision, offline))
        return cls(**networks, card=card)  # type: ignore[call-arg]

    def push_to_hub(self, name: str | Path, *, private: bool = False) -> str:
        """Share the model: its file, the checksum of that, and a page about it.

        Args:
            name: ``user/name`` of a repository of the Hugging Face Hub, created with your login if needed; or a
                ``Path`` of a folder to write instead.
            private: whether only you can see a new repository.

        Returns:
            The commit's address, or the folder's path.

        Raises:
            ImportError: For a repository, if huggingface_hub is not installed (``pip install 'kfit[hub]'``).
            OSError: if the Hub or the disk refuses.
        """
        content = model_content(self.networks, self.card)
        if isinstance(name, Path):
            return str(save_folder(name, content, self.card))
        with TemporaryDirectory() as folder:
            return upload(save_folder(folder, content, self.card), name, private)
