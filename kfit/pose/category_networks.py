"""The networks of one category with their card: on one device, and shared through the Hugging Face Hub or a folder."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import torch
from torch import nn

from kfit.core import Encoder, Generator
from kfit.generators import ExtentsHead
from kfit.geometry import PoseNetwork
from kfit.pose.card import Card
from kfit.pose.hub import find_model, save_folder, upload
from kfit.pose.model_files import model_content, read_model


class CategoryNetworks:
    """What `kfit.pose.CategoryModel` holds; its arguments are described there."""

    def __init__(
        self,
        generator: Generator,
        encoder: Encoder,
        extents: ExtentsHead,
        card: Card,
        pose_head: PoseNetwork | None = None,
    ) -> None:
        self.generator, self.encoder, self.extents, self.card = generator, encoder, extents, card
        self.pose_head = pose_head

    @property
    def device(self) -> torch.device:
        """Device of its networks."""
        return next(self.encoder.parameters()).device

    def to(self, device: str | torch.device) -> Self:
        """Move its networks to a device, on which its fits then run; returns itself."""
        for network in self.networks.values():
            network.to(device)
        return self

    @property
    def networks(self) -> dict[str, nn.Module]:
        """Its networks by their names in the card, as `kfit.models.write_model` takes them."""
        networks = {"generator": self.generator, "encoder": self.encoder, "extents": self.extents}
        return networks if self.pose_head is None else networks | {"pose_head": self.pose_head}

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
        return cls(**networks, card=card)  # type: ignore[arg-type]

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
